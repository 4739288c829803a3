# The core alone, as terrapin::core, for somebody else's firmware (docs/embedding.md): two public headers, no flag, option
# or target of this project that could meet theirs. A release carries the generated files and needs no Python.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
option(TERRAPIN_INSTALL "Install terrapin::core" ${PROJECT_IS_TOP_LEVEL})
if(PROJECT_IS_TOP_LEVEL AND NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    set(CMAKE_BUILD_TYPE Release)
endif()

set(TERRAPIN_GENERATED ${PROJECT_SOURCE_DIR}/generated)
if(EXISTS ${TERRAPIN_GENERATED}/terrapin_interface.c)
    if(DEFINED TERRAPIN_ROBOT)
        message(FATAL_ERROR "terrapin: TERRAPIN_ROBOT is ${TERRAPIN_ROBOT}, expected none with a release, whose C was "
            "generated for one robot (generated/robot.toml); `make release ROBOT=...` makes that of another")
    endif()
else()
    set(TERRAPIN_ROBOT cylinder CACHE STRING "Name of a shipped robot, or the file of one")
    set(TERRAPIN_OF ${TERRAPIN_ROBOT})
    get_filename_component(TERRAPIN_FILE ${TERRAPIN_ROBOT} ABSOLUTE BASE_DIR ${CMAKE_SOURCE_DIR})
    if(EXISTS ${TERRAPIN_FILE} AND NOT IS_DIRECTORY ${TERRAPIN_FILE})
        set(TERRAPIN_OF ${TERRAPIN_FILE})
    endif()
    find_package(Python3 3.11 REQUIRED COMPONENTS Interpreter)
    set(TERRAPIN_GENERATED ${PROJECT_BINARY_DIR}/generated)
    set(TERRAPIN_GENERATOR ${PROJECT_SOURCE_DIR}/firmware/terrapin_interface)
    file(GLOB TERRAPIN_DESCRIPTION CONFIGURE_DEPENDS ${TERRAPIN_GENERATOR}/*.py ${TERRAPIN_GENERATOR}/*.toml
        ${TERRAPIN_GENERATOR}/robots/*.toml ${TERRAPIN_GENERATOR}/robots/boards/*.toml ${TERRAPIN_OF})
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${TERRAPIN_DESCRIPTION})
    execute_process(
        COMMAND ${Python3_EXECUTABLE} -B ${TERRAPIN_GENERATOR}/generate.py --out ${TERRAPIN_GENERATED} --robot ${TERRAPIN_OF}
        RESULT_VARIABLE TERRAPIN_FAILED)
    if(TERRAPIN_FAILED)
        message(FATAL_ERROR "terrapin: no code could be generated from controller.toml")
    endif()
endif()

file(GLOB TERRAPIN_SOURCES CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/firmware/core/*.c)
add_library(terrapin_core STATIC ${TERRAPIN_SOURCES} ${TERRAPIN_GENERATED}/terrapin_interface.c)
add_library(terrapin::core ALIAS terrapin_core)
set_target_properties(terrapin_core PROPERTIES
    EXPORT_NAME core C_STANDARD 11 C_STANDARD_REQUIRED ON C_EXTENSIONS OFF)
terrapin_short_core(terrapin_core)

# The core's own headers are none of theirs: what they include stands in a folder by itself.
set(TERRAPIN_HEADERS ${PROJECT_SOURCE_DIR}/firmware/core/terrapin.h ${TERRAPIN_GENERATED}/terrapin_interface.h)
foreach(header IN LISTS TERRAPIN_HEADERS)
    get_filename_component(name ${header} NAME)
    configure_file(${header} ${PROJECT_BINARY_DIR}/include/${name} COPYONLY)
endforeach()
target_include_directories(terrapin_core
    PUBLIC $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/include> $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
    PRIVATE ${PROJECT_SOURCE_DIR}/firmware/core ${TERRAPIN_GENERATED})

if(TERRAPIN_INSTALL)
    set(TERRAPIN_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/terrapin)
    write_basic_package_version_file(${PROJECT_BINARY_DIR}/terrapinConfigVersion.cmake COMPATIBILITY SameMinorVersion)
    file(RELATIVE_PATH TERRAPIN_PREFIX /${CMAKE_INSTALL_LIBDIR}/pkgconfig /) # the installed place may be moved
    configure_file(${PROJECT_SOURCE_DIR}/firmware/cmake/terrapin-core.pc.in ${PROJECT_BINARY_DIR}/terrapin-core.pc @ONLY)
    install(TARGETS terrapin_core EXPORT terrapin ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT core)
    install(EXPORT terrapin NAMESPACE terrapin:: FILE terrapinConfig.cmake DESTINATION ${TERRAPIN_CMAKE_DIR} COMPONENT core)
    install(FILES ${PROJECT_BINARY_DIR}/terrapinConfigVersion.cmake DESTINATION ${TERRAPIN_CMAKE_DIR} COMPONENT core)
    install(FILES ${PROJECT_BINARY_DIR}/terrapin-core.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT core)
    install(FILES ${TERRAPIN_HEADERS} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT core)
endif()
