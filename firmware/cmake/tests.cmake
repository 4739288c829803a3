# C tests. tests/firmware/test_*_whitebox.c include the .c files that they test and link none of the firmware;
# test_*_blackbox.c know the headers alone and link core, codec and link layer.
enable_testing()
include(firmware/cmake/fuzz.cmake)

find_path(UNITY_DIR unity.c
    HINTS ${UNITY_ROOT} ${UNITY_ROOT}/src
    PATHS /usr/share/cmock/vendor/unity/src /usr/src/unity/src /usr/src/unity /usr/local/src/unity/src)
if(NOT UNITY_DIR)
    message(STATUS "Unity not found (-DUNITY_ROOT=FOLDER): the C unit tests are not built")
    return()
endif()

add_library(unity STATIC ${UNITY_DIR}/unity.c)
target_include_directories(unity SYSTEM PUBLIC ${UNITY_DIR})
target_compile_definitions(unity PUBLIC UNITY_SUPPORT_64)

# What the STM32F405's port decides, without its registers: test_f405_* know it.
set(F405_DIR ${CMAKE_SOURCE_DIR}/firmware/ports/stm32f405)
add_library(f405_logic OBJECT ${F405_DIR}/port.c ${F405_DIR}/can.c ${F405_DIR}/usart.c ${F405_DIR}/ring.c ${F405_DIR}/phases.c)
target_link_libraries(f405_logic PRIVATE core_objects link_objects)
target_compile_options(f405_logic PRIVATE ${STRICT})

file(GLOB TEST_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/tests/firmware/test_*.c)
foreach(file IN LISTS TEST_SOURCES)
    get_filename_component(name ${file} NAME_WE)
    if(name MATCHES "_whitebox$")
        add_executable(${name} ${file})
        add_dependencies(${name} interface)
        target_include_directories(${name} PRIVATE ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link
            ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
        if(TERRAPIN_COVERAGE)
            target_compile_options(${name} PRIVATE --coverage)
            target_link_options(${name} PRIVATE --coverage)
        endif()
    elseif(name MATCHES "_blackbox$")
        add_executable(${name} ${file})
        target_link_libraries(${name} PRIVATE core_objects link_objects)
    else()
        message(FATAL_ERROR "${file}: a C test ends in _whitebox or _blackbox")
    endif()
    if(name MATCHES "^test_f405_")
        target_include_directories(${name} PRIVATE ${F405_DIR})
        if(name MATCHES "_blackbox$")
            target_sources(${name} PRIVATE $<TARGET_OBJECTS:f405_logic>)
        endif()
    endif()
    target_compile_options(${name} PRIVATE ${STRICT})
    target_link_libraries(${name} PRIVATE unity m)
    add_test(NAME ${name} COMMAND ${name})
    set_tests_properties(${name} PROPERTIES TIMEOUT 120)
endforeach()
