// Every file of the corpus through its fuzzer: without clang, and on every run.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/fuzzers/client/fuzzers.h"
#include "tests/fuzzers/service/fuzzers.h"
#include "tests/integration/process.h"

namespace teletact::fuzzers {
namespace {

namespace fs = std::filesystem;

const std::map<std::string, bool (*)(Bytes)> kFuzzers{{"acquisition", acquisition},
                                                      {"address", address},
                                                      {"configuration", configuration},
                                                      {"create_scene", create_scene},
                                                      {"law_book", law_book},
                                                      {"matlab", matlab},
                                                      {"metaimage", metaimage},
                                                      {"publish_slice", publish_slice},
                                                      {"recording", recording},
                                                      {"scene_state", scene_state},
                                                      {"touch_answers", touch_answers},
                                                      {"touch_open", touch_open},
                                                      {"uff", uff}};

fs::path corpus() {
  return fs::path(test::required_environment("TELETACT_SOURCE_DIR")) / "tests/fuzzers/corpus";
}

std::vector<std::uint8_t> bytes_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<fs::path> files_of(const std::string& fuzzer) {
  std::vector<fs::path> files;
  if (fs::is_directory(corpus() / fuzzer))
    for (const auto& entry : fs::directory_iterator(corpus() / fuzzer)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

class Corpus : public testing::TestWithParam<std::string> {};

TEST_P(Corpus, IsReadAsTheProductStates) {
  const auto files = files_of(GetParam());
  ASSERT_FALSE(files.empty()) << "tests/fuzzers/corpus/" << GetParam() << " holds no file";
  std::size_t taken = 0;
  for (const fs::path& file : files) {
    SCOPED_TRACE(file.filename().string());
    const auto bytes = bytes_of(file);
    try {
      taken += kFuzzers.at(GetParam())(bytes);
    } catch (const std::exception& error) {
      ADD_FAILURE() << error.what();
    }
  }
  EXPECT_GT(taken, 0u) << "all of the corpus is refused: its seeds are out of date";
}

INSTANTIATE_TEST_SUITE_P(All, Corpus, testing::ValuesIn([] {
                           std::vector<std::string> names;
                           for (const auto& [name, run] : kFuzzers) names.push_back(name);
                           return names;
                         }()),
                         [](const auto& info) { return info.param; });

TEST(Corpora, AreAllOfAFuzzer) {
  for (const auto& entry : fs::directory_iterator(corpus()))
    EXPECT_TRUE(kFuzzers.contains(entry.path().filename().string()))
        << entry.path() << " belongs to no fuzzer";
}

}  // namespace
}  // namespace teletact::fuzzers
