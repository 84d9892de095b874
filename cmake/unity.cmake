# The unity build: files are compiled several at a time, and what most of them include is compiled once (headers of
# libraries, none of ours). It takes less than half the processor time. The preset `dev` does without, and so proves
# that each file includes what it uses.

if(TELETACT_UNITY)
  set(headers <algorithm> <array> <atomic> <chrono> <cmath> <condition_variable> <cstdint> <deque> <filesystem> <fstream>
    <functional> <future> <map> <memory> <mutex> <optional> <random> <set> <span> <sstream> <stdexcept> <string> <thread>
    <vector> <Eigen/Core>)
  file(WRITE ${PROJECT_BINARY_DIR}/precompiled.cpp "")
  add_library(precompiled STATIC ${PROJECT_BINARY_DIR}/precompiled.cpp)
  target_link_libraries(precompiled PRIVATE teletact_options Eigen3::Eigen)
  target_precompile_headers(precompiled PRIVATE ${headers})
  if(BUILD_TESTING)
    add_library(precompiled_tests STATIC ${PROJECT_BINARY_DIR}/precompiled.cpp)
    target_link_libraries(precompiled_tests PRIVATE teletact_options Eigen3::Eigen GTest::gtest)
    target_compile_options(precompiled_tests PRIVATE ${TELETACT_TEST_OPTIONS})
    target_precompile_headers(precompiled_tests PRIVATE ${headers} <gtest/gtest.h>)
  endif()
endif()

# `count` files of the target at a time: as many as a compiler holds in 1 GB.
function(teletact_unity target count)
  if(TELETACT_UNITY)
    target_precompile_headers(${target} REUSE_FROM precompiled)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${count})
    if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")  # clang does not know it
      target_compile_options(${target} PRIVATE -Wno-subobject-linkage)  # of a file that is not the main one
    endif()
  endif()
endfunction()

# `sources`: files that each hold `count` of the test files that follow. All that a test file defines stands in its
# unnamed namespace, and the same names come again in others: here each gets a namespace of the file's name.
function(teletact_unity_tests sources name count)
  set(written)
  list(LENGTH ARGN size)
  math(EXPR last "${size} - 1")
  foreach(first RANGE 0 ${last} ${count})
    list(SUBLIST ARGN ${first} ${count} batch)
    set(out ${CMAKE_CURRENT_BINARY_DIR}/unity/${name}_${first}.cpp)
    add_custom_command(OUTPUT ${out}
      COMMAND ${CMAKE_COMMAND} -DOUT=${out} "-DSOURCES=${batch}" -P ${PROJECT_SOURCE_DIR}/cmake/unity_tests.cmake
      DEPENDS ${batch} ${PROJECT_SOURCE_DIR}/cmake/unity_tests.cmake VERBATIM)
    list(APPEND written ${out})
  endforeach()
  set(${sources} ${written} PARENT_SCOPE)
endfunction()
