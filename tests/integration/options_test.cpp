// Every option of the command line says what it is for and what it is without being given; files that exist
// are kept; and what a device ignores is not taken.
#include <gtest/gtest.h>

#include "client/commands/commands.h"
#include "tests/integration/kept_out.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(Options, EachSaysWhatItIsForAndItsDefault) {
  CLI::App app;
  client::add_commands(app);
  std::size_t options = 0;
  for (const CLI::App* command : app.get_subcommands({})) {
    EXPECT_FALSE(command->get_description().empty()) << command->get_name();
    for (const CLI::Option* option : command->get_options()) {
      if (option->get_group().empty()) continue;  // of a former version: refused
      const std::string which = command->get_name() + " " + option->get_name();
      const std::string& help = option->get_description();
      EXPECT_FALSE(help.empty()) << which;
      const bool takes_value = option->get_items_expected_max() > 0;
      if (!takes_value || option->get_required() || option->get_positional()) continue;
      ++options;
      EXPECT_TRUE(!option->get_default_str().empty() || has(help, "default") || has(help, "without it"))
          << which << ": " << help;
    }
  }
  EXPECT_GT(options, 60u);
}

class Refusals : public ::testing::Test {
 protected:
  std::string kept(const std::string& name) const {
    std::ofstream(folder / name) << "kept";
    return folder / name;
  }
  void expect_refused(std::vector<std::string> words, const std::vector<std::string>& parts) const {
    words.insert(words.begin(), test::client_binary());
    const test::Outcome outcome = test::run(words, folder / "log");
    EXPECT_NE(outcome.code, 0) << outcome.output;
    for (const std::string& part : parts)
      EXPECT_TRUE(has(outcome.output, part)) << part << ": " << outcome.output;
  }
  test::TemporaryFolder folder;
  const std::string nowhere = "unix:" + (folder / "nowhere");
  const std::string locked = test::address_that_keeps_out();
};

TEST_F(Refusals, AFileThatExistsIsKeptUnlessForced) {
  const std::string file = kept("file");
  const std::vector<std::string> touch = {"touch", "--service", locked, "--scene", "s"};
  const auto with = [](std::vector<std::string> words, const std::vector<std::string>& more) {
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  for (const char* option : {"--record", "--json"})
    expect_refused(with(touch, {option, file}), {option, "it exists", "--force"});
  for (const char* option : {"--record", "--save-tissue"})
    expect_refused({"acquire", "--service", nowhere, "--scene", "s", "--seed", "1", option, file},
                   {option, "it exists", "--force"});
  for (const char* option : {"--save-modulus", "--save-log-std"})
    expect_refused(
        {"acquire", "--service", nowhere, "--scene", "s", "--seed", "1", "--slices", "2", option, file},
        {option, "it exists", "--force"});
  expect_refused({"replay", folder / "other", "--service", nowhere, "--record", file},
                 {"--record", "it exists", "--force"});
  expect_refused(with(touch, {"--json", file, "--force"}), {test::kKeptOut});
  expect_refused(with(touch, {"--json", folder / "new"}), {test::kKeptOut});
  expect_refused(with(touch, {"--json", folder / "absent/new"}), {"--json", "absent"});
  std::string text;
  std::ifstream(file) >> text;
  EXPECT_EQ(text, "kept") << "by sessions that did not begin";
  EXPECT_FALSE(std::filesystem::exists(folder / "new"));
}

TEST_F(Refusals, AnOptionThatIsNoneIsNamedBeforeOneThatIsMissing) {
  expect_refused({"scenes", "--server", nowhere}, {"no option '--server'; scenes --help lists them"});
  expect_refused({"scenes"}, {"--service is required"});
  expect_refused({"scenes", "--service", nowhere, "--x"}, {"--x"});
}

TEST_F(Refusals, MistakeEndsWithTwoAndFailureWithOne) {
  for (const std::string& binary : {test::client_binary(), test::service_binary()}) {
    EXPECT_EQ(test::run({binary, "--help"}, folder / "log").code, 0) << binary;
    EXPECT_EQ(test::run({binary, "--version"}, folder / "log").code, 0) << binary;
    EXPECT_EQ(test::run({binary, "nothing"}, folder / "log").code, 2) << binary;
    EXPECT_EQ(test::run({binary, "--x"}, folder / "log").code, 2) << binary;
  }
  EXPECT_EQ(
      test::run({test::client_binary(), "touch", "--service", nowhere, "--scene", "s", "--rate-hz", "x"},
                folder / "log")
          .code,
      2);
  EXPECT_EQ(
      test::run({test::client_binary(), "touch", "--service", locked, "--scene", "s"}, folder / "log").code,
      1);
}

TEST_F(Refusals, AWatchSaysForWhichRecordingItWaits) {
  test::Process watch({test::client_binary(), "watch", "--session", folder / "t", "--acquire", folder / "a"},
                      folder / "log");
  EXPECT_TRUE(watch.says("waiting for " + (folder / "t") + ": start 'touch --record " + (folder / "t"), 60));
  EXPECT_TRUE(watch.says("waiting for " + (folder / "a") + ": start 'acquire --record", 60));
}

TEST_F(Refusals, WhatADeviceIgnoresIsNotTaken) {
  const auto touch = [&](const std::string& device, const std::vector<std::string>& more) {
    std::vector<std::string> words = {"touch", "--service", nowhere, "--scene", "s", "--device", device};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  };
  for (const auto& [option, value] :
       std::vector<std::pair<std::string, std::string>>{{"--profile", "omni"},
                                                        {"--passes", "2"},
                                                        {"--indentation-m", "0.003"},
                                                        {"--speed-m-s", "0.1"},
                                                        {"--hand-mass-kg", "0.1"},
                                                        {"--begin-m", "0.01"}})
    expect_refused(touch("inverse3", {option, value}), {option, "leave it out"});
  expect_refused(touch("replay:x", {"--speed-m-s", "0.1"}), {"--speed-m-s", "leave it out"});
  expect_refused(touch("simulated", {"--start-x-m", "0.1"}), {"--start-x-m", "leave it out"});
  for (const char* device : {"simulated", "replay:x"})
    expect_refused(touch(device, {"--scale", "2"}), {"--scale", "leave it out"});
  expect_refused(touch("inverse3", {"--scale", "0.5"}), {"--scale: give 1 to 20"});
  expect_refused(touch("inverse3", {"--force-scale", "2"}), {"--force-scale: give 0.05 to the scale"});
  expect_refused(touch("inverse3", {"--axes", "x,z,y"}), {"--axes: 'x,z,y' is a mirror image"});
  expect_refused({"experiment", "--person", "--device", "inverse3", "--profile", "omni"},
                 {"--profile", "leave it out"});
}

}  // namespace
}  // namespace teletact
