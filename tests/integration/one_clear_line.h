// How a command refuses.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "tests/integration/process.h"

namespace teletact::test {

// With all these words, and an exit code that is a refusal's.
inline void expect_one_clear_line(const Outcome& outcome, const std::vector<std::string>& words) {
  EXPECT_GT(outcome.code, 0) << outcome.output;
  EXPECT_LT(outcome.code, 126) << "crashed or was not found: " << outcome.output;
  for (const std::string& word : words)
    EXPECT_NE(outcome.output.find(word), std::string::npos) << "no '" << word << "' in: " << outcome.output;
  const auto lines = std::count(outcome.output.begin(), outcome.output.end(), '\n');
  EXPECT_EQ(lines, 1) << outcome.output;
}

}  // namespace teletact::test
