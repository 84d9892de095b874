// What took long is a line of the log, under the trace of who called, with its stages.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <optional>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "service/base/log_formatter.h"
#include "tests/rpc/estimate_client.h"
#include "tests/support/kept_log.h"

namespace teletact::service {
namespace {

using std::chrono::milliseconds;

const std::string kTrace = "4bf92f3577b34da6a3ce929d0e0e4736", kParent = "00f067aa0ba902b7";
constexpr milliseconds kNever = std::chrono::hours(1);

class SlowCalls : public testing::Test {
 protected:
  SlowCalls() {
    rpc_device();  // silences the log before
    log_.emplace(log_formatter());
  }
  // All of what takes longer is told.
  void serve(milliseconds call, milliseconds answer) {
    server.emplace("", "", Limits{}, tissue_models(), std::vector<DeviceOptions>{}, false,
                   SlowTimes{call, answer, milliseconds(0)});
    (*server)->make_ready();
  }
  // Lines with this event, from its key on. Ends the service.
  std::vector<std::string> told(const std::string& event) {
    server.reset();
    std::istringstream log(log_->text());
    std::vector<std::string> all;
    for (std::string line; std::getline(log, line);)
      if (const auto at = line.find("event=" + event + " "); at != std::string::npos)
        all.push_back(line.substr(at));
    return all;
  }
  void create(const std::vector<std::string>& traceparents) {
    grpc::ClientContext context;
    set_deadline(context);
    for (const std::string& one : traceparents) context.AddMetadata("traceparent", one);
    v1::Scene scene;
    EXPECT_TRUE(
        v1::Palpation::NewStub(server->channel())->CreateScene(&context, uniform_scene(""), &scene).ok());
  }

 private:
  std::optional<test::KeptLog> log_;  // outlives who logs

 protected:
  std::optional<RunningServer> server;
};

// "displacement strain" for "displacement_s=[0-9.]+ strain_s=[0-9.]+ ".
std::string times(const std::string& stages) {
  return std::regex_replace(stages, std::regex("\\w+"), "$&_s=[0-9]+\\.[0-9]{4}");
}

void expect_line(const std::string& line, const std::string& pattern) {
  EXPECT_TRUE(std::regex_match(line, std::regex(pattern))) << line << "\n" << pattern;
}

TEST_F(SlowCalls, AreToldOfUnderTheTraceOfTheirCaller) {
  serve(milliseconds(0), kNever);
  create({"00-" + kTrace + "-" + kParent + "-01"});
  const auto calls = told("slow_call");
  ASSERT_EQ(calls.size(), 1U);
  expect_line(calls[0], "event=slow_call method=teletact\\.v1\\.Palpation/CreateScene code=0 " +
                            times("took answer taken") + " left_out=0 trace=" + kTrace);
}

TEST_F(SlowCalls, AHostileTraceparentIsNobodysTrace) {
  serve(milliseconds(0), kNever);
  const std::string valid = "00-" + kTrace + "-" + kParent + "-01";
  const std::vector<std::vector<std::string>> hostile{{},
                                                      {valid, valid},
                                                      {""},
                                                      {std::string(4000, 'a')},
                                                      {"00-" + kTrace + "-\"},{\"-01"},
                                                      {"ff" + valid.substr(2)}};
  for (const auto& one : hostile) create(one);
  std::set<std::string> traces;
  for (const std::string& line : told("slow_call")) {
    expect_line(line, ".* trace=[0-9a-f]{32}");
    traces.insert(line.substr(line.size() - kTrace.size()));
  }
  EXPECT_EQ(traces.size(), hostile.size());
  EXPECT_EQ(traces.count(kTrace), 0U);
}

TEST_F(SlowCalls, AnEstimateSaysItsStagesAndARefusedOneItsCode) {
  v1::CreateSceneRequest empty = uniform_scene("s");
  empty.clear_modulus();
  serve(milliseconds(0), kNever);
  ASSERT_TRUE(server->create(empty).ok());
  ASSERT_TRUE(estimate(server->channel(), acquisition("s", 0.02)).status.ok());
  EXPECT_EQ(estimate(server->channel(), acquisition("none")).status.error_code(),
            grpc::StatusCode::NOT_FOUND);
  auto calls = told("slow_call");
  std::erase_if(calls, [](const std::string& line) { return line.find("/Estimate ") == std::string::npos; });
  ASSERT_EQ(calls.size(), 2U);
  std::ranges::sort(calls);  // by their code: the service may be done with them in another order
  const std::string estimate = "event=slow_call method=teletact\\.v1\\.Elastography/Estimate code=";
  expect_line(calls[0], estimate + "0 " +
                            times("took upload queued displacement strain modulus publish answer taken") +
                            " left_out=0 trace=.*");
  expect_line(calls[1], estimate + "5 took_s=.*");
}

TEST_F(SlowCalls, ThoseThatAreNotSlowAreNotToldOf) {
  serve(kNever, kNever);
  ASSERT_TRUE(server->create(uniform_scene("s")).ok());
  Toucher toucher(server->channel(), "s");
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));
  EXPECT_TRUE(toucher.finish().ok());
  EXPECT_TRUE(told("slow_call").empty());
  EXPECT_TRUE(told("slow_answer").empty());
}

// Not by who answered: the stream's trace stands there all the same.
TEST_F(SlowCalls, ATouchIsToldOfByItsSlowAnswers) {
  serve(milliseconds(0), -kNever);
  ASSERT_TRUE(server->create(uniform_scene("s")).ok());
  Toucher toucher(server->channel(), "s");
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));
  EXPECT_TRUE(toucher.finish().ok());
  const auto opened = told("touch_opened"), answers = told("slow_answer");
  ASSERT_EQ(opened.size(), 1U);
  ASSERT_FALSE(answers.empty());
  const std::string trace = opened[0].substr(opened[0].rfind(" trace="));
  for (const std::string& line : answers)
    expect_line(line, "event=slow_answer stream=[0-9]+ " + times("took queued computed") +
                          " left_out=[0-9]+" + trace);
  // However long its peer keeps the stream open.
  for (const std::string& line : told("slow_call"))
    EXPECT_EQ(line.find("/Touch "), std::string::npos) << line;
}

}  // namespace
}  // namespace teletact::service
