# What most files include, compiled once: headers of libraries, none of ours. The preset `dev` does without, and so
# proves that each file includes what it uses. Files that speak gRPC are compiled several at a time besides: what they
# make of its headers is then made once for all of them.

if(TELETACT_PRECOMPILE)
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
    target_precompile_headers(precompiled_tests PRIVATE ${headers} <gtest/gtest.h>)
  endif()
endif()

# `from`: precompiled or precompiled_tests.
function(teletact_precompiled target from)
  if(TELETACT_PRECOMPILE)
    target_precompile_headers(${target} REUSE_FROM ${from})
  endif()
endfunction()

# The target's files are compiled several at a time.
function(teletact_together target)
  if(TELETACT_PRECOMPILE AND TARGET ${target})
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8)
  endif()
endfunction()
