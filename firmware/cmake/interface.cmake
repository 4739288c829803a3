# Codec, tables, DBC and reference from the one description. Any Python from 3.11 on will do.
find_package(Python3 3.11 REQUIRED COMPONENTS Interpreter)

# The robot that the firmware is built for: one of terrapin_interface/robots, or a file.
set(TERRAPIN_ROBOT cylinder CACHE STRING "Name of a shipped robot, or the file of one")
set(INTERFACE_DIR ${CMAKE_SOURCE_DIR}/firmware/terrapin_interface)
file(GLOB INTERFACE_SCRIPTS CONFIGURE_DEPENDS ${INTERFACE_DIR}/*.py)
file(GLOB ROBOT_FILES CONFIGURE_DEPENDS ${INTERFACE_DIR}/robots/*.toml
    ${INTERFACE_DIR}/robots/boards/*.toml)
if(EXISTS ${TERRAPIN_ROBOT})
    list(APPEND ROBOT_FILES ${TERRAPIN_ROBOT})
endif()
# The images are named after its board.
execute_process(COMMAND ${Python3_EXECUTABLE} -B ${INTERFACE_DIR}/generate.py --board --robot ${TERRAPIN_ROBOT}
    OUTPUT_VARIABLE ROBOT_BOARD ERROR_VARIABLE wrong RESULT_VARIABLE failed)
if(failed)
    message(FATAL_ERROR "${wrong}")
endif()
list(GET ROBOT_BOARD 1 BOARD_FILE)
list(GET ROBOT_BOARD 0 ROBOT_BOARD)
list(APPEND ROBOT_FILES ${BOARD_FILE})
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${ROBOT_FILES})
set(CDEF_HEADERS
    ${CMAKE_SOURCE_DIR}/firmware/core/terrapin.h
    ${CMAKE_SOURCE_DIR}/firmware/link/slcan.h
    ${CMAKE_SOURCE_DIR}/firmware/store/flash.h
    ${CMAKE_SOURCE_DIR}/firmware/store/parameters.h
    ${CMAKE_SOURCE_DIR}/firmware/ports/host/flash_file.h
    ${CMAKE_SOURCE_DIR}/firmware/link/node.h
    ${CMAKE_SOURCE_DIR}/firmware/link/chaskey.h
    ${CMAKE_SOURCE_DIR}/firmware/link/seal.h
    ${CMAKE_SOURCE_DIR}/firmware/link/dispatch.h)
set(HEADER_OPTIONS ${CDEF_HEADERS})
list(TRANSFORM HEADER_OPTIONS PREPEND "--header=")

# The stamp is what the build waits for: a generated file whose text stays the same keeps its time. It carries the time
# before the reading, so that an edit made meanwhile is seen by the next build.
add_custom_command(
    OUTPUT ${GENERATED}/stamp
    BYPRODUCTS
        ${GENERATED}/terrapin_interface.c ${GENERATED}/terrapin_interface.h ${GENERATED}/terrapin_pack.h ${GENERATED}/terrapin_scaling.h ${GENERATED}/terrapin_cdef.h
        ${GENERATED}/terrapin.dbc ${GENERATED}/interface.json ${GENERATED}/interface.md ${GENERATED}/robot.toml ${GENERATED}/board.toml ${GENERATED}/terrapin_board.h
    COMMAND ${CMAKE_COMMAND} -E make_directory ${GENERATED}
    COMMAND ${CMAKE_COMMAND} -E touch ${GENERATED}/stamp.begun
    COMMAND ${Python3_EXECUTABLE} -B ${INTERFACE_DIR}/generate.py --out ${GENERATED} --robot ${TERRAPIN_ROBOT} ${HEADER_OPTIONS}
    COMMAND ${CMAKE_COMMAND} -E rename ${GENERATED}/stamp.begun ${GENERATED}/stamp
    DEPENDS ${INTERFACE_SCRIPTS} ${INTERFACE_DIR}/controller.toml ${CDEF_HEADERS} ${ROBOT_FILES}
    COMMENT "Generating the interface from controller.toml"
    VERBATIM)
add_custom_target(interface ALL DEPENDS ${GENERATED}/stamp)
set_source_files_properties(${GENERATED}/terrapin_interface.c ${GENERATED}/terrapin_interface.h ${GENERATED}/terrapin_pack.h ${GENERATED}/terrapin_scaling.h PROPERTIES GENERATED TRUE)

# What the description states and no C file uses fails the build.
file(GLOB_RECURSE FIRMWARE_FILES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/*.c ${CMAKE_SOURCE_DIR}/firmware/*.h)
add_custom_command(
    OUTPUT ${GENERATED}/all-used
    COMMAND ${Python3_EXECUTABLE} -B ${INTERFACE_DIR}/unread.py --sources ${CMAKE_SOURCE_DIR}/firmware --stamp ${GENERATED}/all-used
    DEPENDS ${GENERATED}/stamp ${FIRMWARE_FILES}
    COMMENT "Looking for limits and signals that no code uses"
    VERBATIM)
add_custom_target(unread ALL DEPENDS ${GENERATED}/all-used)
