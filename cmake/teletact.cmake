# Shared by every CMakeLists.txt: compile options and one function per kind of target.

add_library(teletact_options INTERFACE)
target_compile_options(teletact_options INTERFACE -Wall -Wextra $<$<BOOL:${TELETACT_WERROR}>:-Werror>)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12's own AVX-512 headers set it off inside Eigen (GCC bug 105593).
  target_compile_options(teletact_options INTERFACE -Wno-uninitialized -Wno-maybe-uninitialized)
endif()
if(TELETACT_NATIVE)
  target_compile_options(teletact_options INTERFACE -march=native)
elseif(TELETACT_LEVELS)
  target_compile_options(teletact_options INTERFACE -march=${TELETACT_LEVEL})
endif()
if(TELETACT_SANITIZE)
  target_compile_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE} -fno-omit-frame-pointer)
  target_link_options(teletact_options INTERFACE -fsanitize=${TELETACT_SANITIZE})
  if(TELETACT_SANITIZE MATCHES "fuzzer")
    # What is found ends the run, undefined behaviour too.
    target_compile_options(teletact_options INTERFACE -fno-sanitize-recover=all)
    target_compile_definitions(teletact_options INTERFACE _GLIBCXX_ASSERTIONS)
  endif()
  if(TELETACT_SANITIZE STREQUAL "thread")
    target_compile_options(teletact_options INTERFACE -Wno-tsan)  # Boost.Asio's fences, which it does not see
  endif()
endif()
target_include_directories(teletact_options INTERFACE ${PROJECT_SOURCE_DIR})

# `sources`: the paths of the names that follow, which are all that the folder has with this ending; tests count apart.
function(teletact_sources sources folder ending)
  list(TRANSFORM ARGN REPLACE "(.+)" "${PROJECT_SOURCE_DIR}/${folder}/\\1${ending}" OUTPUT_VARIABLE listed)
  list(SORT listed)
  file(GLOB found CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/${folder}/*${ending})
  if(ending STREQUAL ".cpp")
    list(FILTER found EXCLUDE REGEX "_test\\.cpp$")
  endif()
  if(NOT "${listed}" STREQUAL "${found}")
    message(FATAL_ERROR "${folder}: its sources are not those that CMakeLists.txt lists")
  endif()
  set(${sources} ${listed} PARENT_SCOPE)
endfunction()

# One static library per folder: teletact_module(service/device LIBRARIES ...) -> service_device,
# made of SOURCES, without their .cpp.
function(teletact_module folder)
  cmake_parse_arguments(arg "" "" "SOURCES;LIBRARIES" ${ARGN})
  string(REPLACE "/" "_" name ${folder})
  teletact_sources(sources ${folder} .cpp ${arg_SOURCES})
  if(sources)
    add_library(${name} STATIC ${sources})
    target_link_libraries(${name} PUBLIC teletact_options ${arg_LIBRARIES})
    teletact_precompiled(${name} precompiled)
  else()
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE teletact_options ${arg_LIBRARIES})
  endif()
endfunction()

# One test binary per folder of tests/: teletact_tests(imaging LIBRARIES ...) -> imaging_test, one ctest
# entry each, with its own OpenCL kernel cache. LABELS go to ctest. What tests a half of teletact that is not
# built is left out. SOURCES: without their _test.cpp. UNTIMED: waits for no clock, so that others may run
# beside it (ctest -j); the rest run alone.
function(teletact_tests folder)
  cmake_parse_arguments(arg "UNTIMED" "" "SOURCES;LIBRARIES;LABELS" ${ARGN})
  if((NOT TELETACT_SERVICE AND "${arg_LIBRARIES}" MATCHES "service_|bench_")
     OR (NOT TELETACT_CLIENT AND "${arg_LIBRARIES}" MATCHES "client_|bench_"))
    return()
  endif()
  teletact_sources(sources tests/${folder} _test.cpp ${arg_SOURCES})
  string(REPLACE "/" "_" name ${folder})
  add_executable(${name}_test ${sources})
  target_link_libraries(${name}_test PRIVATE teletact_options tests_support ${arg_LIBRARIES} GTest::gtest GTest::gtest_main)
  teletact_precompiled(${name}_test precompiled_tests)
  add_test(NAME ${name} COMMAND ${name}_test)
  file(MAKE_DIRECTORY ${PROJECT_BINARY_DIR}/pocl-cache/${name})
  if("data" IN_LIST arg_LABELS)  # recorded data that may be absent: ctest then says Skipped, not Passed
    set_tests_properties(${name} PROPERTIES SKIP_REGULAR_EXPRESSION "SKIPPED")
  endif()
  if(NOT arg_UNTIMED)
    set_tests_properties(${name} PROPERTIES RUN_SERIAL ON)
  endif()
  set_tests_properties(${name} PROPERTIES TIMEOUT 900 LABELS "${arg_LABELS}"
    ENVIRONMENT "ASAN_OPTIONS=use_sigaltstack=0;POCL_CACHE_DIR=${PROJECT_BINARY_DIR}/pocl-cache/${name};LSAN_OPTIONS=suppressions=${PROJECT_SOURCE_DIR}/tests/support/lsan.supp;TSAN_OPTIONS=ignore_noninstrumented_modules=1:suppressions=${PROJECT_SOURCE_DIR}/tests/support/tsan.supp;TELETACT_SOURCE_DIR=${PROJECT_SOURCE_DIR};TELETACT_BINARY_DIR=${PROJECT_BINARY_DIR}")
endfunction()
