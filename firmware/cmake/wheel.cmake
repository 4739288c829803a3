# What a wheel holds beside the Python packages (pyproject.toml, [tool.scikit-build]): terrapin_hil/paths.py finds it.
set(WHEEL_NATIVE terrapin_hil/_native)
install(TARGETS terrapin terrapin_hil terrapin_boot LIBRARY DESTINATION ${WHEEL_NATIVE} COMPONENT python EXCLUDE_FROM_ALL)
install(TARGETS terrapin-controller RUNTIME DESTINATION ${WHEEL_NATIVE} COMPONENT python EXCLUDE_FROM_ALL)
install(FILES ${CMAKE_CURRENT_LIST_DIR}/../core/terrapin.h DESTINATION ${WHEEL_NATIVE} COMPONENT python EXCLUDE_FROM_ALL)
install(FILES
    ${GENERATED}/interface.json ${GENERATED}/interface.md ${GENERATED}/terrapin.dbc ${GENERATED}/terrapin_cdef.h
    ${GENERATED}/robot.toml ${GENERATED}/board.toml
    DESTINATION ${WHEEL_NATIVE}/generated COMPONENT python EXCLUDE_FROM_ALL)
# What the boot loader's library is read by (terrapin_hil/run/boot_loader.py).
install(FILES ${GENERATED}/terrapin_interface.h DESTINATION ${WHEEL_NATIVE}/generated COMPONENT python EXCLUDE_FROM_ALL)
foreach(folder core store boot)
    file(GLOB headers ${CMAKE_CURRENT_LIST_DIR}/../${folder}/*.h)
    install(FILES ${headers} DESTINATION ${WHEEL_NATIVE}/headers/${folder} COMPONENT python EXCLUDE_FROM_ALL)
endforeach()
install(DIRECTORY ${CMAKE_CURRENT_LIST_DIR}/../../cases/ DESTINATION terrapin_hil/_cases COMPONENT python EXCLUDE_FROM_ALL
    PATTERN ".terrapin" EXCLUDE)

# The controllers of further robots, each a build of its own; the simulator is the same for all.
set(TERRAPIN_WHEEL_ROBOTS "" CACHE STRING "Shipped robots whose controllers a wheel holds beside that of TERRAPIN_ROBOT")
foreach(robot IN LISTS TERRAPIN_WHEEL_ROBOTS)
    set(place ${CMAKE_BINARY_DIR}/robots/${robot})
    add_custom_target(controller-${robot} ALL
        COMMAND ${CMAKE_COMMAND} -S ${CMAKE_SOURCE_DIR} -B ${place} -G ${CMAKE_GENERATOR}
            -DCMAKE_MAKE_PROGRAM=${CMAKE_MAKE_PROGRAM} -DCMAKE_C_COMPILER=${CMAKE_C_COMPILER}
            -DCMAKE_BUILD_TYPE=${CMAKE_BUILD_TYPE} -DPython3_EXECUTABLE=${Python3_EXECUTABLE}
            -DTERRAPIN_GPIO=${TERRAPIN_GPIO} -DTERRAPIN_HIL=OFF -DTERRAPIN_ROBOT=${robot}
        COMMAND ${CMAKE_COMMAND} --build ${place} --target terrapin terrapin-controller terrapin_boot interface
        COMMENT "The controller of the robot ${robot}"
        VERBATIM)
    set(there ${WHEEL_NATIVE}/robots/${robot})
    set(library ${CMAKE_SHARED_LIBRARY_PREFIX}terrapin)
    install(PROGRAMS ${place}/${library}${CMAKE_SHARED_LIBRARY_SUFFIX} ${place}/terrapin-controller
        ${place}/${library}_boot${CMAKE_SHARED_LIBRARY_SUFFIX} DESTINATION ${there} COMPONENT python EXCLUDE_FROM_ALL)
    foreach(file interface.json interface.md terrapin.dbc terrapin_cdef.h terrapin_interface.h robot.toml board.toml)
        install(FILES ${place}/generated/${file} DESTINATION ${there}/generated COMPONENT python EXCLUDE_FROM_ALL)
    endforeach()
endforeach()
