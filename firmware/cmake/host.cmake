# Ports to the host: the shared library that Python opens, and the process that speaks SLCAN on a pty or tty.
add_library(terrapin SHARED $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:link_objects>
    ${CMAKE_SOURCE_DIR}/firmware/ports/host/flash_file.c)
target_include_directories(terrapin PRIVATE ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/store)
target_compile_options(terrapin PRIVATE ${STRICT})
target_compile_definitions(terrapin PRIVATE TERRAPIN_SHARED)
set_target_properties(terrapin PROPERTIES C_VISIBILITY_PRESET hidden)
target_link_options(terrapin PRIVATE -Wl,-Bsymbolic -Wl,--no-undefined)

file(GLOB PROCESS_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/ports/host/*.c)
add_executable(terrapin-controller ${PROCESS_SOURCES} $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:link_objects>)
target_include_directories(terrapin-controller PRIVATE ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link
    ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
target_compile_options(terrapin-controller PRIVATE ${STRICT})
add_dependencies(terrapin-controller interface)

if(TERRAPIN_COVERAGE)
    target_link_options(terrapin PRIVATE --coverage)
    target_link_options(terrapin-controller PRIVATE --coverage)
endif()
if(CMAKE_C_FLAGS MATCHES "-fsanitize=")
    # The sanitizers' run-time stands in the program that opens the library, not in the library.
    get_target_property(options terrapin LINK_OPTIONS)
    list(REMOVE_ITEM options -Wl,--no-undefined)
    set_target_properties(terrapin PROPERTIES LINK_OPTIONS "${options}")
endif()
