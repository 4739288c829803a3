# The boot loader: its keys, and on the host its library and its process over an emulated flash.
set(TERRAPIN_KEY "" CACHE FILEPATH "PEM of the Ed25519 key (public or private) that images must be signed with")
set(TERRAPIN_NEXT_KEY "" CACHE FILEPATH "PEM of the key that takes its place when it is revoked (`terrapin keys revoke`)")
option(TERRAPIN_RELEASE "A boot loader for robots that leave the workshop: needs TERRAPIN_KEY, the public key alone" OFF)
if(TERRAPIN_RELEASE AND NOT TERRAPIN_KEY)
    message(FATAL_ERROR "TERRAPIN_RELEASE: expected -DTERRAPIN_KEY=PUBLIC.pem, the key that images are signed with")
endif()
set(BENCH_KEY ${CMAKE_SOURCE_DIR}/build/keys/development.pem)
if(TERRAPIN_KEY)
    set(BOOT_KEY_OPTIONS --key ${TERRAPIN_KEY})
    if(TERRAPIN_RELEASE)
        list(APPEND BOOT_KEY_OPTIONS --release --bench ${BENCH_KEY})
    endif()
else() # a key for the bench, one for all builds of this tree; `make clean` removes it
    set(BOOT_KEY_OPTIONS --make --key ${BENCH_KEY})
endif()
if(TERRAPIN_NEXT_KEY)
    list(APPEND BOOT_KEY_OPTIONS --next ${TERRAPIN_NEXT_KEY})
endif()
set(BOOT_DIR ${CMAKE_SOURCE_DIR}/firmware/boot)
add_custom_command(
    OUTPUT ${GENERATED}/boot_key.h
    COMMAND ${CMAKE_COMMAND} -E make_directory ${GENERATED}
    COMMAND ${Python3_EXECUTABLE} -B ${BOOT_DIR}/boot_key.py ${BOOT_KEY_OPTIONS} --out ${GENERATED}/boot_key.h
    DEPENDS ${BOOT_DIR}/boot_key.py ${TERRAPIN_KEY} ${TERRAPIN_NEXT_KEY}
    COMMENT "The boot loader's public keys"
    VERBATIM)
add_custom_target(boot_key DEPENDS ${GENERATED}/boot_key.h)

file(GLOB BOOT_SOURCES CONFIGURE_DEPENDS ${BOOT_DIR}/*.c)
add_library(boot_objects OBJECT ${BOOT_SOURCES})
add_dependencies(boot_objects interface)
target_include_directories(boot_objects PUBLIC ${BOOT_DIR} ${CMAKE_SOURCE_DIR}/firmware/store
    ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link ${GENERATED})
target_compile_options(boot_objects PRIVATE ${STRICT} -ffunction-sections -fdata-sections)
if(TERRAPIN_LIBFUZZER)
    target_compile_options(boot_objects PRIVATE -fsanitize=fuzzer-no-link)
endif()
if(TERRAPIN_COVERAGE)
    target_compile_options(boot_objects PRIVATE --coverage)
    target_link_options(boot_objects PUBLIC --coverage)
endif()

if(NOT CMAKE_CROSSCOMPILING)
    set_target_properties(boot_objects PROPERTIES POSITION_INDEPENDENT_CODE ON)
    # What stands beside the boot loader's objects in its host programs.
    add_library(boot_host OBJECT ${CMAKE_SOURCE_DIR}/firmware/store/flash_emulated.c
        ${CMAKE_SOURCE_DIR}/firmware/store/crc32.c ${GENERATED}/terrapin_interface.c
        ${CMAKE_SOURCE_DIR}/firmware/link/slcan.c ${CMAKE_SOURCE_DIR}/firmware/link/node.c)
    add_dependencies(boot_host interface)
    target_include_directories(boot_host PRIVATE ${CMAKE_SOURCE_DIR}/firmware/store ${CMAKE_SOURCE_DIR}/firmware/core
        ${CMAKE_SOURCE_DIR}/firmware/link ${GENERATED})
    target_compile_options(boot_host PRIVATE ${STRICT})
    set_target_properties(boot_host PROPERTIES POSITION_INDEPENDENT_CODE ON)

    add_library(terrapin_boot SHARED $<TARGET_OBJECTS:boot_objects> $<TARGET_OBJECTS:boot_host>)
    target_link_options(terrapin_boot PRIVATE -Wl,-Bsymbolic)
    add_executable(terrapin-bootloader ${CMAKE_SOURCE_DIR}/firmware/ports/host_boot/process.c
        $<TARGET_OBJECTS:boot_objects> $<TARGET_OBJECTS:boot_host>)
    add_dependencies(terrapin-bootloader boot_key interface)
    target_include_directories(terrapin-bootloader PRIVATE $<TARGET_PROPERTY:boot_objects,INTERFACE_INCLUDE_DIRECTORIES>)
    target_compile_options(terrapin-bootloader PRIVATE ${STRICT})
    if(TERRAPIN_COVERAGE)
        target_link_options(terrapin_boot PRIVATE --coverage)
        target_link_options(terrapin-bootloader PRIVATE --coverage)
    endif()
endif()
