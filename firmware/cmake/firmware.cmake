# The core (with the codec) and the link layer: what every port is made of.
file(GLOB CORE_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/core/*.c)
file(GLOB LINK_SOURCES CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/firmware/link/*.c)
list(APPEND LINK_SOURCES ${CMAKE_SOURCE_DIR}/firmware/store/parameters.c ${CMAKE_SOURCE_DIR}/firmware/store/crc32.c)

add_library(core_objects OBJECT ${CORE_SOURCES} ${GENERATED}/terrapin_interface.c)
add_library(link_objects OBJECT ${LINK_SOURCES})
# The same without test mode, for production images. The core has nothing of it: its objects are the same in both.
add_library(link_production_objects OBJECT ${LINK_SOURCES})
target_compile_definitions(link_production_objects PRIVATE TERRAPIN_PRODUCTION)
foreach(part core_objects link_objects link_production_objects)
    add_dependencies(${part} interface)
    target_include_directories(${part} PUBLIC ${CMAKE_SOURCE_DIR}/firmware/core ${CMAKE_SOURCE_DIR}/firmware/link
        ${CMAKE_SOURCE_DIR}/firmware/store ${GENERATED})
    target_compile_options(${part} PRIVATE ${STRICT} -ffunction-sections -fdata-sections)
    if(NOT CMAKE_CROSSCOMPILING)
        target_compile_definitions(${part} PRIVATE TERRAPIN_SHARED)
        set_target_properties(${part} PROPERTIES POSITION_INDEPENDENT_CODE ON C_VISIBILITY_PRESET hidden)
    endif()
    if(TERRAPIN_LIBFUZZER)
        target_compile_options(${part} PRIVATE -fsanitize=fuzzer-no-link)
    endif()
    if(TERRAPIN_COVERAGE)
        target_compile_options(${part} PRIVATE --coverage)
        target_link_options(${part} PUBLIC --coverage)
    endif()
endforeach()

terrapin_short_core(core_objects)

# No floating point in the core: the compiler itself refuses it where it can.
check_c_compiler_flag(-mgeneral-regs-only HAS_GENERAL_REGS_ONLY)
if(HAS_GENERAL_REGS_ONLY)
    target_compile_options(core_objects PRIVATE -mgeneral-regs-only)
endif()

add_library(core STATIC $<TARGET_OBJECTS:core_objects>)
set_target_properties(core PROPERTIES OUTPUT_NAME terrapin_core)
