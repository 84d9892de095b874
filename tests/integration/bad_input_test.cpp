// Bad input to the commands: one clear line that names what is wrong and the remedy, and a non-zero exit.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <memory>
#include <tuple>

#include "client/link/recording.h"
#include "tests/integration/kept_out.h"
#include "tests/integration/one_clear_line.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

using test::Environment;
using test::expect_one_clear_line;
using test::Outcome;
using test::TemporaryFolder;

void write_file(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

// A MetaImage of 64 x 8 int16 samples with the given element spacing line (or none).
std::string mha(const std::string& spacing) {
  std::string text = "ObjectType = Image\nNDims = 2\nBinaryData = True\nBinaryDataByteOrderMSB = False\n";
  if (!spacing.empty()) text += "ElementSpacing = " + spacing + "\n";
  text += "DimSize = 64 8\nElementType = MET_SHORT\nElementDataFile = LOCAL\n";
  return text + std::string(64 * 8 * 2, '\1');
}

class EstimateInput : public ::testing::Test {
 protected:
  Outcome estimate(const std::string& pre, const std::string& post, std::vector<std::string> more) {
    std::vector<std::string> command{test::client_binary(),
                                     "estimate",
                                     "--service",
                                     address,
                                     "--pre",
                                     pre,
                                     "--post",
                                     post,
                                     "--center-frequency-hz",
                                     "7.3e6",
                                     "--sampling-frequency-hz",
                                     "40e6"};
    command.insert(command.end(), more.begin(), more.end());
    return test::run(command, folder_ / "log");
  }
  std::string address = test::address_that_keeps_out();
  std::vector<std::string> usual(std::vector<std::string> more = {}) {
    more.insert(more.end(), {"--out", folder_ / "out", "--frame", "PROBE"});
    return more;
  }
  TemporaryFolder folder_;
};

TEST_F(EstimateInput, CorruptFilesAreNamed) {
  write_file(folder_ / "a.mha", "ObjectType = Image\nNDims = 2\nDimSize = 64");
  expect_one_clear_line(estimate(folder_ / "a.mha", folder_ / "a.mha", usual()), {"a.mha"});
  write_file(folder_ / "b.mat", "MATLAB 5.0 MAT-file, or not");
  expect_one_clear_line(
      estimate(folder_ / "b.mat", folder_ / "b.mat", usual({"--variable", "rf", "--axial-axis", "rows"})),
      {"b.mat"});
  write_file(folder_ / "e.uff", "HDF5, or not");
  expect_one_clear_line(estimate(folder_ / "e.uff", folder_ / "e.uff", usual()), {"e.uff"});
  expect_one_clear_line(estimate(folder_ / "c.mha", folder_ / "c.mha", usual()), {"c.mha"});
  write_file(folder_ / "d.png", "x");
  expect_one_clear_line(estimate(folder_ / "d.png", folder_ / "d.png", usual()), {"d.png", ".mha"});
}

TEST_F(EstimateInput, WhatIsMissingIsAskedForByName) {
  write_file(folder_ / "a.mha", mha(""));
  const std::string a = folder_ / "a.mha";
  expect_one_clear_line(estimate(a, a, usual()), {"give --line-pitch-m: the file has no lateral spacing"});
  expect_one_clear_line(estimate(a, a, {"--out", folder_ / "out"}), {"give --frame PROBE", "--frame LAB"});
  expect_one_clear_line(estimate(a, a, usual({"--force-n", "3"})), {"--contact-area-m2"});
  write_file(folder_ / "b.mat", "x");
  expect_one_clear_line(estimate(a, a, usual({"--sound-speed-m-s", "1.54"})), {"--sound-speed-m-s", "1540"});
  expect_one_clear_line(estimate(folder_ / "b.mat", folder_ / "b.mat", usual()), {"--variable"});
  expect_one_clear_line(estimate(folder_ / "b.mat", folder_ / "b.mat", usual({"--variable", "rf"})),
                        {"--axial-axis"});
}

TEST_F(EstimateInput, SpacingAgainstTheSamplingRateIsRefused) {
  write_file(folder_ / "mm.mha", mha("0.01925 0.234"));
  expect_one_clear_line(estimate(folder_ / "mm.mha", folder_ / "mm.mha", usual()),
                        {"millimetres", "--spacing-unit mm"});
  write_file(folder_ / "wrong.mha", mha("2.2e-5 0.000234"));
  expect_one_clear_line(estimate(folder_ / "wrong.mha", folder_ / "wrong.mha", usual()),
                        {"c / (2 fs)", "--sampling-frequency-hz", "--spacing-unit"});
  write_file(folder_ / "right.mha", mha("1.925e-5 0.000234"));
  expect_one_clear_line(
      estimate(folder_ / "right.mha", folder_ / "right.mha", usual({"--line-pitch-m", "0.0003"})),
      {"--line-pitch-m", "contradicts"});
  const std::string right = folder_ / "right.mha";
  expect_one_clear_line(estimate(right, right, usual({"--spacing-unit", "mm"})),
                        {"metres: give --spacing-unit m\n"});
}

TEST_F(EstimateInput, FrequenciesInMegahertzAreRefused) {
  write_file(folder_ / "a.mha", mha("1.925e-5 0.000234"));
  for (const auto& [center, sampling, words] :
       {std::tuple{"7.3e6", "40", "--sampling-frequency-hz 40: give it in Hz; 40 MHz is 40e6"},
        std::tuple{"7.3", "40e6", "--center-frequency-hz 7.3: give it in Hz; 7.3 MHz is 7.3e6"}})
    expect_one_clear_line(
        test::run({test::client_binary(), "estimate", "--service", "unix:/tmp/tt-nobody", "--pre",
                   folder_ / "a.mha", "--post", folder_ / "a.mha", "--center-frequency-hz", center,
                   "--sampling-frequency-hz", sampling, "--frame", "PROBE", "--out", folder_ / "out"},
                  folder_ / "log"),
        {words});
}

TEST_F(EstimateInput, OfSeveralPairsWhatDoesNotFitIsNamed) {
  for (const char* name : {"a.mha", "b.mha", "c.mha"}) write_file(folder_ / name, mha("1.925e-5 0.000234"));
  const std::string a = folder_ / "a.mha", b = folder_ / "b.mha", c = folder_ / "c.mha";
  expect_one_clear_line(estimate(a, a, usual({"--pre", b, "--post", b, c})),
                        {"--pre is given 2 times, --post 3", "once for each pair"});
  expect_one_clear_line(estimate(a, a, usual({"--post", b, c, "--z-m", "0", "0.001", "0.005"})),
                        {"--z-m", "evenly"});
  write_file(folder_ / "d.mha", mha("1.925e-5 0.000300"));
  expect_one_clear_line(estimate(a, b, usual({"--pre", folder_ / "d.mha", "--post", folder_ / "d.mha"})),
                        {"d.mha", "another line pitch"});
  std::string frames = mha("1.925e-5 0.000234 1") + std::string(64 * 8 * 2, '\1');
  frames.replace(frames.find("NDims = 2"), 9, "NDims = 3");
  frames.replace(frames.find("DimSize = 64 8"), 14, "DimSize = 64 8 2");
  write_file(folder_ / "frames.mha", frames);
  const std::string all = folder_ / "frames.mha";
  expect_one_clear_line(estimate(all, all, usual()), {"give --pre-frame", "holds 2 frames"});
  expect_one_clear_line(estimate(all, all, usual({"--pre-frame", "0", "--post-frame", "1", "2"})),
                        {"--post-frame 2", "holds frames 0 to 1"});
  expect_one_clear_line(estimate(all, all, usual({"--pre-frame", "0", "--post-frame", "1"})),
                        {test::kKeptOut});
}

TEST_F(EstimateInput, UnwritableOutputFolderIsSaidFirst) {
  write_file(folder_ / "file", "not a folder");
  expect_one_clear_line(
      estimate("/nonexistent.mha", "/nonexistent.mha", {"--out", folder_ / "file/out", "--frame", "LAB"}),
      {"file/out", "--out"});
}

TEST_F(EstimateInput, AServiceThatIsNotThereIsSaid) {
  write_file(folder_ / "a.mha", mha("1.925e-5 0.000234"));
  address = "unix:/tmp/tt-nobody";
  test::Process touch({test::client_binary(), "touch", "--service", address, "--scene", "s"},
                      folder_ / "touch.log");  // waits for it beside
  expect_one_clear_line(estimate(folder_ / "a.mha", folder_ / "a.mha", usual()),
                        {"unix:/tmp/tt-nobody", "teletact-service"});
  const int code = touch.wait(60);
  expect_one_clear_line({code, touch.output()}, {"no service at unix:/tmp/tt-nobody", "teletact-service"});
}

// Names are taken in any case, and what is allowed is listed plainly.
TEST_F(EstimateInput, NamesAreListedPlainly) {
  write_file(folder_ / "a.mha", mha("1.925e-5 0.000234"));
  const std::string a = folder_ / "a.mha";
  const Outcome method = estimate(a, a, usual({"--modulus-method", "spoon"}));
  EXPECT_NE(method.output.find("{direct,iterative,reference-stress,solid}"), std::string::npos)
      << method.output;
  EXPECT_EQ(method.output.find("magic"), std::string::npos) << method.output;
  expect_one_clear_line(estimate(a, a,
                                 {"--out", folder_ / "out", "--frame", "probe", "--modulus-method", "Direct",
                                  "--plane", "STRESS"}),
                        {test::kKeptOut});
  std::string as_float = mha("1.925e-5 0.000234") + std::string(64 * 8 * 2, '\1');
  as_float.replace(as_float.find("MET_SHORT"), 9, "MET_FLOAT");
  write_file(folder_ / "b.mha", as_float);
  expect_one_clear_line(estimate(a, folder_ / "b.mha", usual()), {"--pre holds int16", "--post float32"});
}

TEST(AcquireInput, NeedsATissueAndOneThatCanBeRead) {
  TemporaryFolder folder;
  const std::string client = test::client_binary();
  expect_one_clear_line(
      test::run({client, "acquire", "--service", "unix:/tmp/tt-nobody", "--scene", "s"}, folder / "log"),
      {"--tissue", "--seed"});
  write_file(folder / "t.toml", "[tissue]\nwidth = 3\n");
  expect_one_clear_line(test::run({client, "acquire", "--service", "unix:/tmp/tt-nobody", "--scene", "s",
                                   "--tissue", folder / "t.toml"},
                                  folder / "log"),
                        {"t.toml", "width"});
  for (const char* start : {"99", "-0.01", "nan"})
    EXPECT_NE(test::run({client, "acquire", "--service", "unix:/tmp/tt-nobody", "--scene", "s", "--seed", "1",
                         "--start-x-m", start},
                        folder / "log")
                  .output.find("--start-x-m"),
              std::string::npos)
        << start;
}

TEST(AcquireInput, SlicesThatCannotBeTakenAreRefusedInWords) {
  TemporaryFolder folder;
  write_file(folder / "plane.toml", "[tissue]\nwidth_m = 0.1\n");
  write_file(folder / "thin.toml", "[tissue]\nwidth_m = 0.1\n[solid]\nelevational_width_m = 0.03\n");
  const auto refused = [&](const std::vector<std::string>& more, const std::vector<std::string>& words) {
    std::vector<std::string> command{test::client_binary(), "acquire", "--service",
                                     "unix:/tmp/tt-nobody", "--scene", "s"};
    command.insert(command.end(), more.begin(), more.end());
    expect_one_clear_line(test::run(command, folder / "log"), words);
  };
  refused({"--tissue", folder / "plane.toml", "--slices", "3"}, {"--slices 3", "[solid]"});
  refused({"--tissue", folder / "thin.toml", "--slices", "6"}, {"from z -0.0125 to 0.0125", "-0.01 to 0.01"});
  refused({"--tissue", folder / "thin.toml", "--slices", "1", "--first-slice-z-m", "0.02"}, {"z 0.02"});
  refused({"--seed", "1", "--slices", "3", "--start-x-m", "0.01"}, {"--start-x-m", "--slices", "leave one"});
  refused({"--seed", "1", "--slices", "3", "--plane", "strain"}, {"--plane", "--slices", "leave one"});
  refused({"--seed", "1", "--slices", "3", "--modulus-method", "direct"}, {"--modulus-method", "--slices"});
  refused({"--seed", "1", "--slices", "2", "--save-modulus", folder / "a", "--save-log-std", folder / "./a"},
          {"--save-modulus", "same file"});
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"--slices", "0"},
                                             {"--slices", "-1"},
                                             {"--slices", "2", "--slice-pitch-m", "0"},
                                             {"--slices", "2", "--slice-pitch-m", "nan"},
                                             {"--slice-pitch-m", "0.01"},
                                             {"--unlike-model"}}) {
    std::vector<std::string> command{
        test::client_binary(), "acquire", "--service", "unix:/tmp/tt-nobody", "--scene", "s", "--seed", "1"};
    command.insert(command.end(), words.begin(), words.end());
    const test::Outcome outcome = test::run(command, folder / "log");
    EXPECT_NE(outcome.code, 0) << words.front();
    EXPECT_NE(outcome.output.find(words.front() == "--slices" && words.size() > 2 ? words[2] : words.front()),
              std::string::npos)
        << outcome.output;
  }
}

// One file under two names, by another spelling, a link, or before it exists, is refused before anything is
// opened for writing: what was recorded stays.
TEST(RecordInput, WhatIsReadIsNeverWrittenOver) {
  TemporaryFolder folder;
  const std::string client = test::client_binary(), record = folder / "x.record", kept = "what was recorded";
  write_file(record, kept);
  std::filesystem::create_symlink(record, folder / "link");
  const auto refused = [&](std::vector<std::string> more, const std::vector<std::string>& words) {
    std::vector<std::string> command{client};
    command.insert(command.end(), more.begin(), more.end());
    command.insert(command.end(), {"--service", "unix:/tmp/tt-nobody"});
    expect_one_clear_line(test::run(command, folder / "log"), words);
    std::ifstream in(record);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), kept);
  };
  const std::string spelt =
      folder / "./../" + std::filesystem::path(folder / "").parent_path().filename().string() + "/x.record";
  for (const std::string& name : {record, folder / "link", spelt}) {
    refused({"replay", record, "--record", name}, {"--record", "the recording that is played", "same file"});
    refused({"touch", "--scene", "s", "--device", "replay:" + record, "--record", name},
            {"--record", "--device replay", "same file"});
    refused({"acquire", "--scene", "s", "--tissue", record, "--record", name},
            {"--record", "--tissue", "same file"});
  }
  refused({"touch", "--scene", "s", "--record", folder / "new", "--json", folder / "./new"},
          {"--json", "--record", "same file"});
}

TEST(BenchInput, AForeignReplotAndUnwritableOutputsAreSaidAtOnce) {
  TemporaryFolder folder;
  const std::string bench = test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench";
  write_file(folder / "foreign.json", R"({"suite": "throughput"})");
  write_file(folder / "text.json", "not JSON");
  write_file(folder / "list.json", R"([1, 2])");
  write_file(folder / "number.json", R"({"suite": 3})");
  write_file(folder / "empty.json", R"({"suite": "exploration"})");
  for (const char* name : {"foreign.json", "text.json", "list.json", "number.json", "empty.json"})
    expect_one_clear_line(
        test::run({bench, "exploration", "--replot", folder / name, "--out", folder / "out"}, folder / "log"),
        {"--replot", name, "exploration"});
  write_file(folder / "file", "not a folder");
  for (const char* suite : {"exploration", "stability", "contact"}) {
    expect_one_clear_line(test::run({bench, suite, "--json", folder / "file/x.json"}, folder / "log"),
                          {"--json", "file/x.json"});
    expect_one_clear_line(test::run({bench, suite, "--out", folder / "file/out"}, folder / "log"),
                          {"--out", "file/out"});
  }
  // What is there is left alone: without --force, and with it by the look alone.
  write_file(folder / "kept.json", "kept");
  expect_one_clear_line(test::run({bench, "exploration", "--json", folder / "kept.json"}, folder / "log"),
                        {"--json", "kept.json", "--force"});
  test::run({bench, "exploration", "--force", "--json", folder / "kept.json", "--out", folder / "file/out"},
            folder / "log");
  for (const char* word : {"nothing", "--x"})
    EXPECT_EQ(test::run({bench, word}, folder / "log").code, 2) << word;
  std::ifstream kept(folder / "kept.json");
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(kept), {}), "kept");
  test::run({bench, "exploration", "--json", folder / "new.json", "--out", folder / "file/out"},
            folder / "log");
  EXPECT_FALSE(std::filesystem::exists(folder / "new.json"));
}

TEST(TouchInput, WhatCannotBeIsRefusedInWords) {
  TemporaryFolder folder;
  const auto touch = [&](std::vector<std::string> more) {
    std::vector<std::string> command{test::client_binary(), "touch", "--scene", "s"};
    command.insert(command.end(), more.begin(), more.end());
    return test::run(command, folder / "log");
  };
  const auto refused = [&](const std::vector<std::string>& more, const std::vector<std::string>& words) {
    const Outcome outcome = touch(more);
    EXPECT_GT(outcome.code, 0);
    for (const std::string& word : words)
      EXPECT_NE(outcome.output.find(word), std::string::npos) << "no '" << word << "' in: " << outcome.output;
  };
  for (const char* address :
       {"localhost", "http://localhost:50051", "localhost:", ":50051", "localhost:99999"})
    refused({"--service", address}, {"--service", "give HOST:PORT or unix:/path"});
  const std::string nobody = "unix:/tmp/tt-nobody";
  for (const char* radius : {"0", "-1", "nan", "x"})
    refused({"--service", nobody, "--tip-radius-m", radius}, {"--tip-radius-m", "number above 0"});
  for (const char* option : {"--tip-radius-m", "--tip-half-width-m"})
    refused({"--service", nobody, option, "8"}, {option, "8: give it in metres, at most 0.014"});
  for (const char* duration : {"-1", "nan"})
    refused({"--service", nobody, "--duration-s", duration}, {"--duration-s", "0 or more"});
  for (const char* wait : {"-1", "nan"})
    refused({"--service", nobody, "--wait-s", wait}, {"--wait-s", "0 or more"});
  for (const char* option : {"--indentation-m", "--speed-m-s", "--begin-m", "--hand-mass-kg",
                             "--hand-damping-n-s-m", "--hand-stiffness-n-m", "--period-s", "--layer-depth-m"})
    refused({"--service", nobody, option, "nan"}, {option, "finite number"});
}

// The script answers for itself what needs no build.
TEST(ScriptInput, HelpBuildsNothingAndAnEmptyDemoIsRefused) {
  TemporaryFolder folder;
  const std::string script = test::required_environment("TELETACT_SOURCE_DIR") + "/teletact";
  const Environment nowhere{{"TELETACT_BUILD_DIR", folder / "build"}};
  const auto say = [&](std::vector<std::string> words, const std::string& expected, int code) {
    words.insert(words.begin(), {"/bin/sh", script});
    const Outcome outcome = test::run(words, folder / "log", nowhere);
    EXPECT_EQ(outcome.code, code) << outcome.output;
    EXPECT_NE(outcome.output.find(expected), std::string::npos) << outcome.output;
  };
  say({"build", "--help"}, "usage: ./teletact build", 0);
  say({"test", "-h"}, "usage: ./teletact test", 0);
  say({"--version"}, "teletact " TELETACT_VERSION, 0);
  for (const char* none : {"0", "0.0", "-3"}) say({"demo", "--duration-s", none}, "--duration-s", 2);
  say({"demo", "--help"}, "--solid-given", 0);
  say({"demo", "--passes", "3"}, "only --plane and --page", 2);
  say({"demo", "--solid"}, "solid without it", 2);
  say({"demo", "--plane", "--page"}, "--plane and --page are two demos", 2);
  say({"demo", "--solid-given", "--passes", "3"}, "only --plane and --page", 2);
  say({"demo", "--pages"}, "unknown argument of demo: --pages", 2);
  say({"demo", "--seed", "abc"}, "--seed must be a whole number", 2);
  say({"demo", "--seed"}, "--seed needs a value", 2);
  say({"demo", "--plane", "--tissue", script}, "of the demo without --plane", 2);
  say({"demo", "--tissue", script, "--seed", "1"}, "--seed and --tissue are two patients", 2);
  say({"demo", "--tissue", folder / "none.toml"}, "--tissue: cannot read", 2);
  say({"demo", "--page", "--round-trip-ms", "100"}, "the page has a button for it", 2);
  say({"wacth"}, "unknown command: wacth", 2);
  EXPECT_FALSE(std::filesystem::exists(folder / "build"));
  for (const char* binary : {"/client/teletact-client", "/service/teletact-service"}) {
    const std::string path = test::required_environment("TELETACT_BINARY_DIR") + binary;
    const Outcome outcome = test::run({path, "--version"}, folder / "log");
    EXPECT_EQ(outcome.code, 0);
    EXPECT_NE(outcome.output.find(TELETACT_VERSION), std::string::npos) << outcome.output;
  }
}

TEST(WatchInput, WhatIsNoSessionIsNotWaitedFor) {
  TemporaryFolder folder;
  write_file(folder / "x", "nothing that was recorded");
  const auto refused = [&](std::vector<std::string> words, const std::vector<std::string>& expected) {
    words.insert(words.begin(), {test::client_binary(), "watch"});
    const Outcome outcome = test::run(words, folder / "log");
    expect_one_clear_line(outcome, expected);
    EXPECT_EQ(outcome.code, 2);
  };
  refused({}, {"--session", "--recording"});
  refused({"--session", folder / "x"}, {"--session", "is not a teletact-client recording"});
  write_file(folder / "y", "nothing that was acquired");
  refused({"--session", folder / "x", "--acquire", folder / "y"},
          {"--session", "is not a teletact-client recording"});
}

TEST(ReportInput, RecordingsMustBeWhatTheyAreSaidToBe) {
  TemporaryFolder folder;
  write_file(folder / "x.record", "nothing that was recorded");
  expect_one_clear_line(
      test::run({test::client_binary(), "report", "--tissue", folder / "t.toml", "--touch-record",
                 folder / "x.record", "--acquire-record", folder / "x.record", "--out", folder / "out"},
                folder / "log"),
      {"x.record", "recording"});
}

}  // namespace
}  // namespace teletact
