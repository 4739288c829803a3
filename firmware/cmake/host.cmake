# Ports to the host: the shared library that Python opens, and terrapin-controller. On Linux that is the whole controller
# (SocketCAN, GPIO); elsewhere it speaks SLCAN on a pty or tty only, which it also does on Linux.
add_library(terrapin SHARED $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:link_objects>
    ${CMAKE_SOURCE_DIR}/firmware/ports/host/flash_file.c)
target_include_directories(terrapin PRIVATE ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
target_compile_options(terrapin PRIVATE ${STRICT})
target_compile_definitions(terrapin PRIVATE TERRAPIN_SHARED)
set_target_properties(terrapin PROPERTIES C_VISIBILITY_PRESET hidden)
target_link_options(terrapin PRIVATE -Wl,-Bsymbolic -Wl,--no-undefined)

file(GLOB PROCESS_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/ports/host/*.c)
if(CMAKE_SYSTEM_NAME STREQUAL "Linux")
    list(REMOVE_ITEM PROCESS_SOURCES ${CMAKE_SOURCE_DIR}/firmware/ports/host/main.c) # that port has its own
    file(GLOB LINUX_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/ports/linux/*.c)
    list(APPEND PROCESS_SOURCES ${LINUX_SOURCES})
endif()
add_executable(terrapin-controller ${PROCESS_SOURCES} $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:link_objects>)
target_include_directories(terrapin-controller PRIVATE ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link
    ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
target_include_directories(terrapin-controller PRIVATE ${CMAKE_SOURCE_DIR}/firmware/ports/host)
target_compile_options(terrapin-controller PRIVATE ${STRICT})
add_dependencies(terrapin-controller interface)

# libgpiod 1.6 and 2 have different functions. What links for this very machine counts: a 32-bit build finds the header too.
option(TERRAPIN_GPIO "terrapin-controller drives GPIO lines where libgpiod is there (a program that then needs it)" ON)
include(CheckCSourceCompiles)
set(CMAKE_REQUIRED_LIBRARIES gpiod)
check_c_source_compiles("#include <gpiod.h>\nint main(void) { return gpiod_line_request_get_fd(0); }" HAS_LIBGPIOD_2)
check_c_source_compiles("#include <gpiod.h>\nint main(void) { return gpiod_line_event_get_fd(0); }" HAS_LIBGPIOD_1)
unset(CMAKE_REQUIRED_LIBRARIES)
if(NOT TERRAPIN_GPIO)
    message(STATUS "terrapin-controller is built without GPIO lines, as TERRAPIN_GPIO says")
elseif(HAS_LIBGPIOD_2)
    target_compile_definitions(terrapin-controller PRIVATE TERRAPIN_LIBGPIOD=2)
    target_link_libraries(terrapin-controller PRIVATE gpiod)
elseif(HAS_LIBGPIOD_1)
    target_compile_definitions(terrapin-controller PRIVATE TERRAPIN_LIBGPIOD=1)
    target_link_libraries(terrapin-controller PRIVATE gpiod)
else()
    message(STATUS "libgpiod not found (libgpiod-dev): terrapin-controller is built without GPIO lines")
    unset(HAS_LIBGPIOD_1 CACHE) # looked for again next time: it may be installed by then
    unset(HAS_LIBGPIOD_2 CACHE)
endif()

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
