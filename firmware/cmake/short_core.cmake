# terrapin_short_core(TARGET): the core's text is near its limit: without these steps of GCC for ARM it is 200 bytes shorter
# and takes no more instructions. Other compilers do not know them.
function(terrapin_short_core target)
    if(CMAKE_C_COMPILER_ID STREQUAL "GNU" AND CMAKE_SYSTEM_PROCESSOR MATCHES "^(arm$|cortex-m)")
        target_compile_options(${target} PRIVATE -fno-schedule-insns2)
        set_property(SOURCE ${PROJECT_SOURCE_DIR}/firmware/core/integer.c PROPERTY COMPILE_OPTIONS -fno-tree-ch)
        set_property(SOURCE ${PROJECT_SOURCE_DIR}/firmware/core/calibration.c ${PROJECT_SOURCE_DIR}/firmware/core/gains.c
            PROPERTY COMPILE_OPTIONS -fno-tree-forwprop)
        set_property(SOURCE ${PROJECT_SOURCE_DIR}/firmware/core/sense.c PROPERTY COMPILE_OPTIONS -fira-region=all)
    endif()
endfunction()
