// Two types of one name in one namespace are one to the linker, whichever members it finds first.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <regex>

#include "tests/integration/process.h"

namespace teletact {
namespace {

namespace fs = std::filesystem;

// "teletact::client::Tissue" -> the headers that define it. Types stand at the beginning of a line.
std::map<std::string, std::vector<std::string>> types_of_headers() {
  const fs::path root = test::required_environment("TELETACT_SOURCE_DIR");
  const std::regex opens(R"(^namespace ([\w:]+) \{)"),
      defines(R"(^(?:class|struct|enum class|enum) (\w+)(?: final)?(?: : [^;()]*)? \{)");
  std::map<std::string, std::vector<std::string>> types;
  for (const char* folder : {"client", "service", "bench", "tests"})
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (entry.path().extension() != ".h") continue;
      std::ifstream text(entry.path());
      std::string inside;
      std::smatch match;
      for (std::string line; std::getline(text, line);) {
        if (std::regex_search(line, match, opens)) inside += match[1].str() + "::";
        if (line.rfind("}  // namespace", 0) == 0) inside.clear();
        if (std::regex_search(line, match, defines))
          types[inside + match[1].str()].push_back(fs::relative(entry.path(), root));
      }
    }
  return types;
}

TEST(Twins, NoTypeIsDefinedInTwoHeaders) {
  const auto types = types_of_headers();
  EXPECT_GT(types.size(), 300u) << "the headers were not read";
  EXPECT_EQ(types.count("teletact::client::TouchLink"), 1u);
  for (const auto& [type, headers] : types)
    EXPECT_EQ(headers.size(), 1u) << type << ": " << headers.front() << ", " << headers.back();
}

}  // namespace
}  // namespace teletact
