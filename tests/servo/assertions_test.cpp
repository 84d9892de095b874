// No assertion can end the process with force on: what runs in a tick has none of its own, and every vector
// and matrix in it has a size that is known when it is compiled.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>

namespace teletact::client {
namespace {

TEST(Assertions, NothingInATickHasOneThatAValueCouldReach) {
  const char* source = std::getenv("TELETACT_SOURCE_DIR");
  ASSERT_NE(source, nullptr) << "run the tests with ctest";
  const std::regex reachable(
      R"(\bassert\s*\(|\babort\s*\(|Eigen::Dynamic|Matrix(X|2X|3X|X2|X3)d|VectorXd|ArrayX)");
  std::size_t files = 0;
  for (const char* folder : {"client/render", "client/servo", "client/haptic"})
    for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(source) / folder)) {
      if (entry.path().extension() != ".cpp" && entry.path().extension() != ".h") continue;
      std::ostringstream text;
      text << std::ifstream(entry.path()).rdbuf();
      const std::string read = text.str();
      EXPECT_FALSE(std::regex_search(read, reachable)) << entry.path();
      ++files;
    }
  EXPECT_GT(files, 40u);
}

}  // namespace
}  // namespace teletact::client
