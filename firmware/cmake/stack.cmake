# How deep the stack of every image can get: printed by `make firmware`, and a test.
find_program(TARGET_OBJDUMP arm-none-eabi-objdump REQUIRED)
set(STACK_FILES $<TARGET_FILE:terrapin-qemu> ${F405_FILES})
foreach(board IN LISTS F405_BOARDS)
    string(REPLACE "_" "-" image terrapin-boot-${board})
    list(APPEND STACK_FILES $<TARGET_FILE:${image}>)
endforeach()
add_test(NAME stack_bound
    COMMAND ${Python3_EXECUTABLE} -B ${CMAKE_SOURCE_DIR}/firmware/cmake/stack_report.py --su ${CMAKE_BINARY_DIR}
        --nm ${TARGET_NM} --objdump ${TARGET_OBJDUMP} ${STACK_FILES})
