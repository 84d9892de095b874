// Psychophysics through the whole system: the simulated person feels tissue on a service, is called away by a
// service that is killed, and goes on.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "client/experiment/fit.h"
#include "client/experiment/results_csv.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

class ExperimentService : public testing::Test {
 protected:
  std::string address() const { return "unix:" + (folder / "s"); }
  void serve() {
    service = std::make_unique<test::Process>(
        std::vector<std::string>{test::service_binary(), "serve", "--listen", address()},
        folder / "service.log");
    ASSERT_TRUE(service->says("serving on", 300)) << service->output();
  }
  static std::vector<std::string> experiment(const std::vector<std::string>& more, bool begins = true) {
    std::vector<std::string> words{test::client_binary(), "experiment", "--trials", "2",
                                   "--resamples",         "20",         "--stimuli"};
    for (const char* word : {"18", "23", "30", "36"}) words.emplace_back(word);
    if (begins) words.insert(words.end(), {"--seed", "2"});
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  void expect_no_scenes() const {
    const test::Outcome scenes =
        test::run({test::client_binary(), "scenes", "--service", address()}, folder / "scenes.log");
    EXPECT_NE(scenes.output.find("no scenes"), std::string::npos) << scenes.output;
  }
  static double jnd(const std::vector<client::AnsweredTrial>& answers) {
    const client::Fit fit = client::fit_weibull(client::count_answers(answers));
    EXPECT_FALSE(fit.at_limit);
    return client::weber_fraction(fit.function, 25);
  }
  test::TemporaryFolder folder;
  std::unique_ptr<test::Process> service;
};

// Springs and tissue are judged with the same chances: what is felt as it should be is judged alike. One
// answer of eight may turn, as two stiffnesses a few per cent apart may.
TEST_F(ExperimentService, KeepsTheJndOfSpringsThroughAKill) {
  const std::string springs = folder / "springs.csv", line = folder / "line.csv",
                    solid = folder / "solid.csv";
  const test::Outcome told = test::run(experiment({"--csv", springs}), folder / "springs.log");
  ASSERT_EQ(told.code, 0) << told.output;
  serve();
  const auto begin = [&](const std::vector<std::string>& words, const std::string& log, bool begins) {
    std::vector<std::string> all{"--service", address()};
    all.insert(all.end(), words.begin(), words.end());
    return std::make_unique<test::Process>(experiment(all, begins), folder / log);
  };
  auto on_solid = begin({"--solid", "--csv", solid}, "solid.log", true);
  ASSERT_TRUE(on_solid->says("trial 3 of 8", 120)) << on_solid->output();
  on_solid->kill(SIGINT);
  EXPECT_GE(on_solid->wait(30), 0) << "too few answers to fit, which it says: " << on_solid->output();
  EXPECT_EQ(on_solid->output().find("may still be on the service"), std::string::npos) << on_solid->output();
  EXPECT_EQ(client::read_results_csv(solid).size(), 2u);
  on_solid = begin({"--solid", "--resume", solid}, "on.log", false);
  auto on_line = begin({"--csv", line}, "line.log", true);  // in its midst when the service is killed
  ASSERT_TRUE(on_solid->says("trial 4 of 8", 120)) << on_solid->output();
  EXPECT_EQ(on_solid->output().find("trial 2 of 8"), std::string::npos) << on_solid->output();

  const std::size_t kept = client::read_results_csv(line).size();
  service->kill(SIGKILL);
  service->wait(10);
  EXPECT_EQ(on_solid->wait(60), 1) << on_solid->output();
  EXPECT_EQ(on_line->wait(60), 1) << on_line->output();
  for (const char* said : {"void", "is lost", "the answers to trials 1 to 3 are in", "continue with --resume",
                           "these scenes may still be on the service"})
    EXPECT_NE(on_solid->output().find(said), std::string::npos) << said << on_solid->output();
  EXPECT_EQ(client::read_results_csv(solid).size(), 3u);
  EXPECT_LE(client::read_results_csv(line).size(), kept + 1);

  serve();
  on_line = begin({"--resume", line}, "line_on.log", false);
  on_solid = begin({"--solid", "--resume", solid}, "solid_on.log", false);
  EXPECT_EQ(on_line->wait(120), 0) << on_line->output();
  EXPECT_EQ(on_solid->wait(120), 0) << on_solid->output();
  expect_no_scenes();

  const auto expected = client::read_results_csv(springs);
  for (const std::string& path : {line, solid}) {
    const auto answers = client::read_results_csv(path);
    ASSERT_EQ(answers.size(), expected.size());
    unsigned turned = 0;
    for (std::size_t k = 0; k < answers.size(); ++k) turned += answers[k].harder != expected[k].harder;
    EXPECT_LE(turned, 1u) << path;
    EXPECT_NEAR(jnd(answers), jnd(expected), turned == 0 ? 1e-9 : 0.2) << path;
  }
}

TEST_F(ExperimentService, WhatSaysNothingHereIsRefusedByName) {
  const auto refused = [&](const std::vector<std::string>& words, const std::vector<std::string>& parts) {
    const test::Outcome outcome = test::run(experiment(words), folder / "log");
    EXPECT_NE(outcome.code, 0) << outcome.output;
    for (const std::string& part : parts)
      EXPECT_NE(outcome.output.find(part), std::string::npos) << part << ": " << outcome.output;
  };
  refused({"--service", address()}, {"no service at"});
  refused({"--service", address(), "--person"}, {"--person", "give --device"});
  refused({"--service", address(), "--renderer", "kalman", "--age-s", "0.1"},
          {"--age-s", "leave one of the two out"});
  refused({"--service", address(), "--depth-m", "0.1"}, {"--depth-m"});
  refused({"--service", "nowhere"}, {"--service", "HOST:PORT"});
  refused({"--solid"}, {"--solid", "--service"});
  refused({"--tls-ca", "x"}, {"--tls-ca"});
  refused({"--counterbalanced"}, {"--counterbalanced", "--person or --service"});
  refused({"--inclusion-m", "0.02"}, {"--inclusion-m", "--service"});
  refused({"--person", "--device", "simulated", "--renderer", "law"}, {"--renderer law", "--service"});
}

}  // namespace
}  // namespace teletact
