# The controller for the emulated Cortex-M4 (firmware/ports/qemu): the core's and the link's objects as on the chip.
file(GLOB QEMU_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/ports/qemu/*.c)
add_executable(terrapin-qemu ${QEMU_SOURCES} $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:link_objects>)
set_target_properties(terrapin-qemu PROPERTIES SUFFIX .elf)
add_dependencies(terrapin-qemu interface)
target_include_directories(terrapin-qemu PRIVATE ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link ${GENERATED})
target_compile_options(terrapin-qemu PRIVATE ${STRICT} -ffunction-sections -fdata-sections)
target_link_options(terrapin-qemu PRIVATE -nostartfiles --specs=nano.specs -Wl,--gc-sections
    -Wl,--wrap=terrapin_link_step,--wrap=telemetry_emit,--wrap=terrapin_accept
    -T ${CMAKE_SOURCE_DIR}/firmware/ports/qemu/qemu.ld)
set_target_properties(terrapin-qemu PROPERTIES LINK_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/ports/qemu/qemu.ld)

# What counts the instructions of steps from recorded inputs (firmware/ports/replay): no port, so no image of the product.
set(QEMU_DIR ${CMAKE_SOURCE_DIR}/firmware/ports/qemu)
add_executable(step-replay ${CMAKE_SOURCE_DIR}/firmware/ports/replay/main.c ${QEMU_DIR}/semihosting.c ${QEMU_DIR}/startup.c
    $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:link_objects>)
set_target_properties(step-replay PROPERTIES SUFFIX .elf LINK_DEPENDS ${QEMU_DIR}/qemu.ld)
add_dependencies(step-replay interface)
target_include_directories(step-replay PRIVATE ${QEMU_DIR} ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link
    ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
target_compile_options(step-replay PRIVATE ${STRICT} -ffunction-sections -fdata-sections)
target_link_options(step-replay PRIVATE -nostartfiles --specs=nano.specs -Wl,--gc-sections -T ${QEMU_DIR}/qemu.ld)

# How long a step can get: printed by `make firmware`, and a test.
find_program(TARGET_OBJDUMP arm-none-eabi-objdump REQUIRED)
add_test(NAME step_bound
    COMMAND ${Python3_EXECUTABLE} -B ${CMAKE_SOURCE_DIR}/firmware/cmake/path_report.py --objdump ${TARGET_OBJDUMP}
        $<TARGET_FILE:step-replay> terrapin_step_drive terrapin_step_think)
