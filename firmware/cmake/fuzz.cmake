# Fuzz targets of everything that reads bytes from outside. With clang's libFuzzer (preset fuzz) they search; otherwise the
# same targets run over the corpus and over a bounded, deterministic set of mutations of it.
set(FUZZ_DIR ${CMAKE_SOURCE_DIR}/tests/firmware/fuzz)
set(FUZZ_SECONDS 10 CACHE STRING "Seconds that one libFuzzer test runs")
set(FUZZ_MUTATIONS 50000 CACHE STRING "Mutated inputs that one test without libFuzzer runs")

foreach(name slcan can)
    add_executable(fuzz_${name} ${FUZZ_DIR}/fuzz_${name}.c)
    target_link_libraries(fuzz_${name} PRIVATE core_objects link_objects)
    target_compile_options(fuzz_${name} PRIVATE ${STRICT})
    if(TERRAPIN_LIBFUZZER)
        target_compile_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
        target_link_options(fuzz_${name} PRIVATE -fsanitize=fuzzer)
        file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/corpus/${name})
        add_test(NAME fuzz_${name} COMMAND fuzz_${name} -max_total_time=${FUZZ_SECONDS} -timeout=5 -max_len=4096 -seed=1
            ${CMAKE_BINARY_DIR}/corpus/${name} ${FUZZ_DIR}/corpus/${name})
    else()
        target_sources(fuzz_${name} PRIVATE ${FUZZ_DIR}/driver.c)
        add_test(NAME fuzz_${name} COMMAND fuzz_${name} ${FUZZ_MUTATIONS} ${FUZZ_DIR}/corpus/${name})
    endif()
    set_tests_properties(fuzz_${name} PROPERTIES TIMEOUT 300)
endforeach()
