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
    teletact_unity(${name} 8)
  else()
    add_library(${name} INTERFACE)
    target_link_libraries(${name} INTERFACE teletact_options ${arg_LIBRARIES})
  endif()
endfunction()

# What a test program, or one that starts the product's, finds in its environment. All share one cache of kernels.
set(TELETACT_TEST_ENVIRONMENT "ASAN_OPTIONS=use_sigaltstack=0" "POCL_CACHE_DIR=${PROJECT_BINARY_DIR}/pocl-cache"
  "LSAN_OPTIONS=suppressions=${PROJECT_SOURCE_DIR}/tests/support/lsan.supp"
  "TSAN_OPTIONS=ignore_noninstrumented_modules=1:suppressions=${PROJECT_SOURCE_DIR}/tests/support/tsan.supp"
  "TELETACT_SOURCE_DIR=${PROJECT_SOURCE_DIR}" "TELETACT_BINARY_DIR=${PROJECT_BINARY_DIR}")
set(TELETACT_TEST_OPTIONS -O1)  # tests are compiled more often than they run

# A ctest entry: teletact_test(NAME tier COMMAND ...). tier: first, or one of the groups in tests/groups.txt.
# TIMED: measures time, so that no other such test runs beside it.
function(teletact_test name tier)
  cmake_parse_arguments(arg "TIMED" "TIMEOUT" "COMMAND;ENVIRONMENT;LABELS;NEEDS" ${ARGN})
  add_test(NAME ${name} COMMAND ${arg_COMMAND})
  if(arg_TIMEOUT)
    set_tests_properties(${name} PROPERTIES TIMEOUT ${arg_TIMEOUT})
  endif()
  if(arg_TIMED)
    set_tests_properties(${name} PROPERTIES RESOURCE_LOCK clock)
  endif()
  set_tests_properties(${name} PROPERTIES LABELS "${tier};${arg_LABELS}"
    ENVIRONMENT "${TELETACT_TEST_ENVIRONMENT};${arg_ENVIRONMENT}" SKIP_RETURN_CODE 77)
  if(arg_NEEDS)
    add_dependencies(tests_${tier} ${arg_NEEDS})
  endif()
endfunction()

# One test binary per folder of tests/: teletact_tests(imaging LIBRARIES ...) -> imaging_test, one ctest entry each.
# What tests a half of teletact that is not built is left out. SOURCES: without their _test.cpp. GROUP: not of the first tier. LATER group=FILTER ...: nor are these cases, a ctest entry of their own.
# NEEDS: targets that it starts or loads. SHARDS: ctest entries among which the cases are dealt out, contact_1 and so on.
# The rest: as in teletact_test.
function(teletact_tests folder)
  cmake_parse_arguments(arg "TIMED" "GROUP;SHARDS;TIMEOUT" "SOURCES;LIBRARIES;LABELS;LATER;NEEDS;ENVIRONMENT" ${ARGN})
  if((NOT TELETACT_SERVICE AND "${arg_LIBRARIES}" MATCHES "service_|bench_")
     OR (NOT TELETACT_CLIENT AND "${arg_LIBRARIES}" MATCHES "client_|bench_"))
    return()
  endif()
  teletact_sources(sources tests/${folder} _test.cpp ${arg_SOURCES})
  string(REPLACE "/" "_" name ${folder})
  if(TELETACT_UNITY)
    teletact_unity_tests(sources ${name} 8 ${sources})
  endif()
  add_executable(${name}_test ${sources})
  target_link_libraries(${name}_test PRIVATE teletact_options tests_support ${arg_LIBRARIES} tests_support_main)
  target_compile_options(${name}_test PRIVATE ${TELETACT_TEST_OPTIONS})
  if(TELETACT_UNITY)
    target_precompile_headers(${name}_test REUSE_FROM precompiled_tests)
  endif()
  set(more TIMEOUT 900)
  foreach(property TIMEOUT LABELS NEEDS)
    if(arg_${property})
      list(APPEND more ${property} ${arg_${property}})
    endif()
  endforeach()
  if(arg_TIMED)
    list(APPEND more TIMED)
  endif()
  set(tier first)
  if(arg_GROUP)
    set(tier ${arg_GROUP})
  endif()
  set(later)
  foreach(group_filter IN LISTS arg_LATER)
    string(REGEX MATCH "^([^=]+)=(.+)$" ignored "${group_filter}")
    teletact_test(${name}_${CMAKE_MATCH_1} ${CMAKE_MATCH_1} ${more} NEEDS ${name}_test
      COMMAND ${name}_test --gtest_filter=${CMAKE_MATCH_2} ENVIRONMENT ${arg_ENVIRONMENT})
    list(APPEND later ${CMAKE_MATCH_2})
  endforeach()
  list(JOIN later ":" later)
  set_property(GLOBAL APPEND_STRING PROPERTY TELETACT_LATER "${folder} ${later}\n")
  list(APPEND more COMMAND ${name}_test ENVIRONMENT "TELETACT_LATER=${later}" ${arg_ENVIRONMENT})
  if(arg_SHARDS)
    foreach(shard RANGE 1 ${arg_SHARDS})
      math(EXPR index "${shard} - 1")
      teletact_test(${name}_${shard} ${tier} ${more} GTEST_TOTAL_SHARDS=${arg_SHARDS} GTEST_SHARD_INDEX=${index})
    endforeach()
  else()
    teletact_test(${name} ${tier} ${more})
  endif()
  add_dependencies(tests_${tier} ${name}_test)
  if("data" IN_LIST arg_LABELS)  # recorded data that may be absent: ctest then says Skipped, not Passed
    set_tests_properties(${name} PROPERTIES SKIP_REGULAR_EXPRESSION "SKIPPED")
  endif()
endfunction()
