# Images for the STM32F405 (firmware/ports/stm32f405): each board alone at the start of flash, and for slots A and B of the
# boot loader, with room for MCUboot's header in front. Desk images have the test mode, production images do not.
set(F405_DIR ${CMAKE_SOURCE_DIR}/firmware/ports/stm32f405)
set(F405_BOARDS ${ROBOT_BOARD} emulated) # terrapin_board.h is the first one's; the second is that on QEMU's machine
set(F405_PLACES "alone|0x08000000|0|0x20000" "slot-a|0x08020000|0x200|0x20000" "slot-b|0x08040000|0x200|0x20000")
find_program(TARGET_OBJCOPY arm-none-eabi-objcopy REQUIRED)

# What every image of this chip begins with; the boot loader uses it as well.
add_library(f405_chip OBJECT ${F405_DIR}/startup.c ${F405_DIR}/processor.c ${F405_DIR}/retained.c ${F405_DIR}/clock.c ${F405_DIR}/pins.c
    ${F405_DIR}/ring.c ${F405_DIR}/usart.c ${F405_DIR}/can.c ${F405_DIR}/flash.c ${F405_DIR}/watchdog.c ${F405_DIR}/unique.c)
add_dependencies(f405_chip interface)
target_include_directories(f405_chip PUBLIC ${F405_DIR} ${CMAKE_SOURCE_DIR}/firmware ${CMAKE_SOURCE_DIR}/firmware/core
    ${CMAKE_SOURCE_DIR}/firmware/link ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
target_compile_options(f405_chip PRIVATE ${STRICT} -ffunction-sections -fdata-sections)

# f405_link(TARGET ORIGIN HEADER LIMIT): link an image for a place in flash; also as .bin, which begins at its vectors.
function(f405_link target origin header limit)
    target_link_options(${target} PRIVATE -nostartfiles --specs=nano.specs -Wl,--gc-sections -Wl,--fatal-warnings
        -Wl,--defsym=image_origin=${origin},--defsym=image_header=${header},--defsym=image_limit=${limit}
        -T ${F405_DIR}/stm32f405.ld)
    set_target_properties(${target} PROPERTIES SUFFIX .elf LINK_DEPENDS ${F405_DIR}/stm32f405.ld)
    add_custom_command(TARGET ${target} POST_BUILD
        COMMAND ${TARGET_OBJCOPY} -O binary $<TARGET_FILE:${target}> ${CMAKE_BINARY_DIR}/${target}.bin VERBATIM)
endfunction()

# What an application needs of the boot loader (to say what runs, to confirm a start): as a library, taken by need.
add_library(boot_client STATIC $<TARGET_OBJECTS:boot_objects>)

set(F405_IMAGES "")
foreach(board IN LISTS F405_BOARDS)
    add_custom_target(images-${board}) # those of one board and its boot loader, for `terrapin image build`
    add_library(f405_${board} OBJECT ${F405_DIR}/main.c ${F405_DIR}/hardware.c ${F405_DIR}/port.c ${F405_DIR}/phases.c ${F405_DIR}/health.c ${F405_DIR}/link_key.c ${F405_DIR}/analog.c
        ${F405_DIR}/bridge.c ${F405_DIR}/encoder.c ${F405_DIR}/reset_cause.c
        ${F405_DIR}/spi.c ${F405_DIR}/imu.c ${F405_DIR}/imu_bus.c ${F405_DIR}/swing.c)
    target_link_libraries(f405_${board} PRIVATE f405_chip)
    target_include_directories(f405_${board} PRIVATE ${CMAKE_SOURCE_DIR}/firmware/boot)
    add_dependencies(f405_${board} boot_key)
    target_compile_options(f405_${board} PRIVATE ${STRICT} -ffunction-sections -fdata-sections)
    target_compile_definitions(f405_${board} PRIVATE TERRAPIN_BOARD="$<IF:$<STREQUAL:${board},emulated>,boards/emulated.h,terrapin_board.h>")
    foreach(place IN LISTS F405_PLACES)
        string(REPLACE "|" ";" words ${place})
        list(GET words 0 name)
        list(GET words 1 origin)
        list(GET words 2 header)
        list(GET words 3 limit)
        foreach(link link_objects link_production_objects)
            string(REGEX REPLACE "link_(production_)?objects" "\\1" kind ${link})
            set(image terrapin-${board}-${kind}${name})
            string(REPLACE "_" "-" image ${image})
            add_executable(${image} $<TARGET_OBJECTS:f405_${board}> $<TARGET_OBJECTS:f405_chip>
                $<TARGET_OBJECTS:core_objects> $<TARGET_OBJECTS:${link}>)
            set_target_properties(${image} PROPERTIES LINKER_LANGUAGE C)
            target_link_libraries(${image} PRIVATE boot_client)
            f405_link(${image} ${origin} ${header} ${limit})
            list(APPEND F405_IMAGES ${image})
            add_dependencies(images-${board} ${image})
        endforeach()
    endforeach()
endforeach()

# Printed by `make firmware`, and a test.
list(TRANSFORM F405_IMAGES REPLACE "(.+)" "$<TARGET_FILE:\\1>" OUTPUT_VARIABLE F405_FILES)
add_test(NAME image_size
    COMMAND ${Python3_EXECUTABLE} -B ${CMAKE_SOURCE_DIR}/firmware/cmake/image_report.py --size ${TARGET_SIZE} ${F405_FILES})
