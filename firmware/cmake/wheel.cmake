# What a wheel holds beside the Python packages (pyproject.toml, [tool.scikit-build]): terrapin_hil/paths.py finds it.
set(WHEEL_NATIVE terrapin_hil/_native)
install(TARGETS terrapin terrapin_hil LIBRARY DESTINATION ${WHEEL_NATIVE} COMPONENT python EXCLUDE_FROM_ALL)
install(TARGETS terrapin-controller RUNTIME DESTINATION ${WHEEL_NATIVE} COMPONENT python EXCLUDE_FROM_ALL)
install(FILES ${CMAKE_CURRENT_LIST_DIR}/../core/terrapin.h DESTINATION ${WHEEL_NATIVE} COMPONENT python EXCLUDE_FROM_ALL)
install(FILES
    ${GENERATED}/interface.json ${GENERATED}/interface.md ${GENERATED}/terrapin.dbc ${GENERATED}/terrapin_cdef.h
    DESTINATION ${WHEEL_NATIVE}/generated COMPONENT python EXCLUDE_FROM_ALL)
install(DIRECTORY ${CMAKE_CURRENT_LIST_DIR}/../../cases/ DESTINATION terrapin_hil/_cases COMPONENT python EXCLUDE_FROM_ALL
    PATTERN ".terrapin" EXCLUDE)
