# Assertions (firmware/core/terrapin_assert.h) are on in what runs on this machine and off in images. Where coverage is
# measured they are off too, so that a line counts for what it does.
if(CMAKE_CROSSCOMPILING OR TERRAPIN_COVERAGE)
    set(TERRAPIN_ASSERTIONS_DEFAULT OFF)
else()
    set(TERRAPIN_ASSERTIONS_DEFAULT ON)
endif()
option(TERRAPIN_ASSERTIONS "Check what must hold inside core, link, store and boot loader" ${TERRAPIN_ASSERTIONS_DEFAULT})
if(TERRAPIN_ASSERTIONS)
    add_compile_definitions(TERRAPIN_ASSERTIONS)
endif()
