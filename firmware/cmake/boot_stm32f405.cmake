# The boot loader's images for the STM32F405, sector 0: one a board. Their size is a test.
foreach(board IN LISTS F405_BOARDS)
    string(REPLACE "_" "-" image terrapin-boot-${board})
    add_executable(${image} ${CMAKE_SOURCE_DIR}/firmware/ports/stm32f405_boot/main.c ${CMAKE_SOURCE_DIR}/firmware/ports/stm32f405_boot/memory.c $<TARGET_OBJECTS:f405_chip>
        $<TARGET_OBJECTS:boot_objects> ${GENERATED}/terrapin_interface.c ${CMAKE_SOURCE_DIR}/firmware/link/slcan.c ${CMAKE_SOURCE_DIR}/firmware/link/node.c
        ${CMAKE_SOURCE_DIR}/firmware/store/crc32.c)
    add_dependencies(${image} boot_key interface)
    target_include_directories(${image} PRIVATE ${CMAKE_SOURCE_DIR}/firmware/boot
        $<TARGET_PROPERTY:f405_chip,INTERFACE_INCLUDE_DIRECTORIES>)
    target_compile_options(${image} PRIVATE ${STRICT} -ffunction-sections -fdata-sections)
    target_compile_definitions(${image} PRIVATE TERRAPIN_BOARD="$<IF:$<STREQUAL:${board},emulated>,boards/emulated.h,terrapin_board.h>")
    f405_link(${image} 0x08000000 0 0x3FC0) # the linker refuses more than the sector's 16 kB less the link key's place
    add_custom_command(TARGET ${image} POST_BUILD COMMAND ${TARGET_SIZE} $<TARGET_FILE:${image}> VERBATIM)
    add_dependencies(images-${board} ${image})
endforeach()
