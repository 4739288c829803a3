# The simulator's compiled part. No contraction and no fast maths: a run is a function of scenario, seed and firmware.
file(GLOB HIL_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/hil/physics/*.c ${CMAKE_SOURCE_DIR}/hil/native/*.c)
if(HIL_SOURCES)
    add_library(terrapin_hil SHARED ${HIL_SOURCES} ${GENERATED}/terrapin_interface.c)
    target_include_directories(terrapin_hil PRIVATE
        ${CMAKE_SOURCE_DIR}/hil/physics ${CMAKE_SOURCE_DIR}/hil/native ${CMAKE_SOURCE_DIR}/firmware/core ${GENERATED})
    target_compile_options(terrapin_hil PRIVATE ${STRICT} -O2 -ffp-contract=off)
    target_link_options(terrapin_hil PRIVATE -Wl,-Bsymbolic)
    target_link_libraries(terrapin_hil PRIVATE m)
    add_dependencies(terrapin_hil interface)
else()
    message(STATUS "No sources in hil/physics and hil/native: the simulator's compiled part is not built")
endif()
