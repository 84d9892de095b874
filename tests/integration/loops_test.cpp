// What loops run over, read from the sources.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <string>

#include "tests/integration/process.h"

namespace teletact {
namespace {

namespace fs = std::filesystem;

// In C++20 the shared_ptr that `f()` returns is gone before the first turn of `for (x : f()->many)`, and with
// it, where nobody else holds them, the many: a snapshot that a publication replaces meanwhile.
TEST(Loops, RunOverNothingThatATemporaryOwns) {
  const std::regex loop(R"re(\bfor \(.* : .*\)->\w+\))re");
  ASSERT_TRUE(std::regex_search("for (const auto& w : scene.snapshot()->windows) {", loop));
  const fs::path root = test::required_environment("TELETACT_SOURCE_DIR");
  std::size_t read = 0;
  for (const char* side : {"bench", "client", "common", "service", "tests"})
    for (const auto& entry : fs::recursive_directory_iterator(root / side)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cpp") continue;
      ++read;
      if (entry.path().filename() == "loops_test.cpp") continue;
      std::ifstream text(entry.path());
      for (std::string line; std::getline(text, line);)
        EXPECT_FALSE(std::regex_search(line, loop))
            << fs::relative(entry.path(), root).string() << ": " << line;
    }
  EXPECT_GT(read, 500U) << "the sources were not found";
}

}  // namespace
}  // namespace teletact
