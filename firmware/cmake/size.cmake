# How large the core is on the chip, and that it needs neither heap nor floating point: printed, and a test.
enable_testing()
find_program(TARGET_NM arm-none-eabi-nm REQUIRED)
find_program(TARGET_SIZE arm-none-eabi-size REQUIRED)
set(ENTRIES terrapin_state_size terrapin_init terrapin_step_drive terrapin_step_think terrapin_parameter_set terrapin_parameter_get)
set(KEEP ${ENTRIES})
list(TRANSFORM KEEP PREPEND "-Wl,-u,")

# Linked with the compiler's helpers and memcpy alone; what no entry point reaches is dropped, as on the chip.
add_executable(core-image $<TARGET_OBJECTS:core_objects>)
set_target_properties(core-image PROPERTIES LINKER_LANGUAGE C)
target_link_options(core-image PRIVATE -nostartfiles --specs=nano.specs -Wl,--gc-sections -Wl,-e,terrapin_step_drive ${KEEP})

add_custom_command(TARGET core-image POST_BUILD
    COMMAND ${Python3_EXECUTABLE} -B ${CMAKE_SOURCE_DIR}/firmware/cmake/size_report.py
        --nm ${TARGET_NM} --size ${TARGET_SIZE} $<TARGET_FILE:core-image>
    VERBATIM)
add_test(NAME core_size
    COMMAND ${Python3_EXECUTABLE} -B ${CMAKE_SOURCE_DIR}/firmware/cmake/size_report.py --check
        --nm ${TARGET_NM} --size ${TARGET_SIZE} $<TARGET_FILE:core-image>)
