// What a peer says of its trace is taken where it is what the standard says, and nothing else is.
#include "service/base/current_trace.h"

#include <gtest/gtest.h>

#include <set>
#include <string>
#include <thread>
#include <vector>

namespace teletact::service {
namespace {

const std::string kTrace = "4bf92f3577b34da6a3ce929d0e0e4736", kParent = "00f067aa0ba902b7";
const std::string kValid = "00-" + kTrace + "-" + kParent + "-01";

TEST(TraceContext, TakesTheTraceOfItsCaller) {
  for (const std::string& text :
       {kValid, "00-" + kTrace + "-" + kParent + "-00", "cc-" + kTrace + "-" + kParent + "-01",
        "cc-" + kTrace + "-" + kParent + "-01-what-will-come"}) {
    EXPECT_EQ(hex(trace_of(text)), kTrace) << text;
  }
}

TEST(TraceContext, WhatIsMalformedBeginsATraceOfItsOwn) {
  std::vector<std::string> hostile{"",
                                   "-",
                                   kValid + "-",
                                   kValid + "-more",
                                   " " + kValid,
                                   kValid + " ",
                                   "ff-" + kTrace + "-" + kParent + "-01",
                                   "cc-" + kTrace + "-" + kParent + "-01x",
                                   "00-" + std::string(32, '0') + "-" + kParent + "-01",
                                   "00-" + kTrace + "-" + std::string(16, '0') + "-01",
                                   "00-4BF92F3577B34DA6A3CE929D0E0E4736-" + kParent + "-01",
                                   std::string(55, '-'),
                                   std::string(55, '\0'),
                                   std::string(8000, 'a'),
                                   std::string(1 << 20, '0')};
  for (std::size_t k = 0; k < kValid.size(); ++k) {
    hostile.push_back(kValid.substr(0, k));
    for (const char c : {'g', '\n', '"', '\0', '\xff', ' ', '+'}) {
      hostile.push_back(kValid);
      hostile.back()[k] = c;
    }
  }
  for (const std::string& text : hostile) {
    const TraceId trace = trace_of(text);
    EXPECT_TRUE(trace);
    EXPECT_NE(hex(trace), kTrace) << text;
  }
  EXPECT_TRUE(trace_of(std::nullopt));
}

TEST(TraceContext, NoIdIsGivenTwice) {
  constexpr std::size_t kThreads = 4, kEach = 20'000;
  std::vector<std::vector<std::string>> given(kThreads);
  std::vector<std::thread> threads;
  for (auto& own : given)
    threads.emplace_back([&own] {
      for (std::size_t k = 0; k < kEach; ++k) own.push_back(hex(trace_of(std::nullopt)));
    });
  for (auto& thread : threads) thread.join();
  std::set<std::string> all;
  for (const auto& own : given) all.insert(own.begin(), own.end());
  EXPECT_EQ(all.size(), kThreads * kEach);
}

}  // namespace
}  // namespace teletact::service
