#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "client/experiment/results_csv.h"
#include "tests/commands/fake_service.h"

namespace teletact::client {
namespace {

// GIVEN the answers of an experiment that broke off after the tenth WHEN it goes on
TEST(ExperimentCommand, TrialsOfOneThatGoesOnAreNumberedOn) {
  const TemporaryFolder folder;
  const std::string csv = folder / "answers.csv";
  const std::vector<std::string> as_it_was{"--trials", "2", "--resamples", "20"};
  const auto experiment = [&](const char* option) {
    std::vector<std::string> words{"experiment", option, csv};
    words.insert(words.end(), as_it_was.begin(), as_it_was.end());
    test::run_command(words);
    return read_results_csv(csv).size();
  };
  const std::size_t all = experiment("--csv");
  ASSERT_GT(all, 10u);
  std::string kept;
  std::ifstream in(csv);
  std::string line;
  for (int k = 0; k < 12 && std::getline(in, line); ++k) kept += line + '\n';  // two lines stand above
  std::ofstream(csv) << kept;
  EXPECT_EQ(experiment("--resume"), all);
}

}  // namespace
}  // namespace teletact::client
