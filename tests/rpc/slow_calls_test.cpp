// What took long stands in the file of spans, under the trace of who called, with its stages.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/files/temporary_folder.h"
#include "tests/rpc/estimate_client.h"

namespace teletact::service {
namespace {

using Json = nlohmann::json;

const std::string kTrace = "4bf92f3577b34da6a3ce929d0e0e4736", kParent = "00f067aa0ba902b7";

// One call or answer: a line of the file.
struct Told {
  std::string name, trace, span, parent;  // parent: empty where there is none
  std::vector<std::string> stages;
  Json code;  // null of what is no call
};

Told told_in(const std::string& line) {
  const Json spans = Json::parse(line).at("resourceSpans").at(0).at("scopeSpans").at(0).at("spans");
  const Json& first = spans.at(0);
  Told told{
      first.at("name"), first.at("traceId"), first.at("spanId"), first.value("parentSpanId", ""), {}, {}};
  const auto at = [](const Json& span, const char* end) {
    return std::stoll(span.at(end).get<std::string>());
  };
  for (std::size_t k = 1; k < spans.size(); ++k) {
    told.stages.push_back(spans.at(k).at("name"));
    EXPECT_EQ(spans.at(k).at("parentSpanId"), told.span);
    EXPECT_EQ(spans.at(k).at("traceId"), told.trace);
    EXPECT_GE(at(spans.at(k), "startTimeUnixNano"), at(first, "startTimeUnixNano"));
    EXPECT_LE(at(spans.at(k), "startTimeUnixNano"), at(spans.at(k), "endTimeUnixNano"));
    EXPECT_LE(at(spans.at(k), "endTimeUnixNano"), at(first, "endTimeUnixNano"));
  }
  for (const Json& attribute : first.value("attributes", Json::array()))
    if (attribute.at("key") == "rpc.grpc.status_code") told.code = attribute.at("value").at("intValue");
  return told;
}

class SlowCalls : public testing::Test {
 protected:
  void serve(double slow_call_s, double slow_answer_s) {
    server.emplace("", "", Limits{}, plane_models(), std::vector<DeviceOptions>{}, false,
                   SpansOptions{path, slow_call_s, slow_answer_s});
    (*server)->make_ready();
  }
  // Ends the service, which writes what it has not written yet.
  std::vector<Told> told(const std::string& name = "") {
    server.reset();
    std::ifstream file(path);
    std::vector<Told> all;
    for (std::string line; std::getline(file, line);) all.push_back(told_in(line));
    std::erase_if(all, [&](const Told& one) { return !name.empty() && one.name != name; });
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
  client::TemporaryFolder folder;
  const std::filesystem::path path = folder / "spans.jsonl";
  std::optional<RunningServer> server;
};

TEST_F(SlowCalls, AreToldOfUnderTheTraceOfTheirCaller) {
  serve(0, 3600);
  create({"00-" + kTrace + "-" + kParent + "-01"});
  const auto calls = told();
  ASSERT_EQ(calls.size(), 1U);
  EXPECT_EQ(calls[0].name, "teletact.v1.Palpation/CreateScene");
  EXPECT_EQ(calls[0].trace, kTrace);
  EXPECT_EQ(calls[0].parent, kParent);
  EXPECT_EQ(calls[0].stages, (std::vector<std::string>{"answer", "taken"}));
  EXPECT_EQ(calls[0].code, "0");
}

TEST_F(SlowCalls, AHostileTraceparentIsNobodysTrace) {
  serve(0, 3600);
  const std::string valid = "00-" + kTrace + "-" + kParent + "-01";
  const std::vector<std::vector<std::string>> hostile{{},
                                                      {valid, valid},
                                                      {""},
                                                      {std::string(4000, 'a')},
                                                      {"00-" + kTrace + "-\"},{\"-01"},
                                                      {"ff" + valid.substr(2)}};
  for (const auto& one : hostile) create(one);
  const auto calls = told();
  EXPECT_EQ(calls.size(), hostile.size());
  for (const Told& call : calls) {
    EXPECT_NE(call.trace, kTrace);
    EXPECT_EQ(call.trace.size(), 32U);
    EXPECT_EQ(call.parent, "");
  }
}

TEST_F(SlowCalls, AnEstimateSaysItsStagesAndARefusedOneItsCode) {
  serve(0, 3600);
  v1::CreateSceneRequest empty = uniform_scene("s");
  empty.clear_modulus();
  ASSERT_TRUE(server->create(empty).ok());
  ASSERT_TRUE(estimate(server->channel(), acquisition("s", 0.02)).status.ok());
  EXPECT_EQ(estimate(server->channel(), acquisition("none")).status.error_code(),
            grpc::StatusCode::NOT_FOUND);
  auto calls = told("teletact.v1.Elastography/Estimate");
  ASSERT_EQ(calls.size(), 2U);
  std::ranges::sort(calls, {}, &Told::code);  // the service may be done with them in another order
  EXPECT_EQ(calls[0].stages, (std::vector<std::string>{"upload", "queued", "displacement", "strain",
                                                       "modulus", "publish", "answer", "taken"}));
  EXPECT_EQ(calls[0].code, "0");
  EXPECT_EQ(calls[1].code, "5");
}

TEST_F(SlowCalls, ThoseThatAreNotSlowAreNotToldOf) {
  serve(3600, 3600);
  ASSERT_TRUE(server->create(uniform_scene("s")).ok());
  Toucher toucher(server->channel(), "s");
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));
  EXPECT_TRUE(toucher.finish().ok());
  EXPECT_TRUE(told().empty());
}

// The first touches of a solid wait for solves of the whole block.
TEST_F(SlowCalls, ATouchIsToldOfByItsSlowAnswers) {
  serve(0, 0);
  const auto soft = [](double, double, double) { return 10e3; };
  ASSERT_TRUE(server->create(solid_scene("s", 10, 20, soft)).ok());
  for (const double x_m : {0.015, 0.02}) {
    Toucher toucher(server->channel(), "s");
    v1::TouchAnswer answer;
    ASSERT_TRUE(toucher.opened());
    for (int k = 0; k < 100 && (*server)->core().spans->written() < 2; ++k)
      ASSERT_TRUE(toucher.touch(x_m + 1e-4 * k, 0.001, &answer));
    EXPECT_TRUE(toucher.finish().ok());
  }
  const auto all = told();
  std::size_t answers = 0;
  for (const Told& one : all) {
    if (one.name != "touch answer") continue;
    ++answers;
    EXPECT_EQ(one.stages, (std::vector<std::string>{"queued", "computed"}));
    EXPECT_TRUE(one.code.is_null());
    EXPECT_EQ(std::count_if(all.begin(), all.end(),
                            [&](const Told& stream) {
                              return stream.name == "teletact.v1.Palpation/Touch" &&
                                     stream.span == one.parent && stream.trace == one.trace;
                            }),
              1);
  }
  EXPECT_GT(answers, 0U);
}

// However long its peer keeps it open.
TEST_F(SlowCalls, AStreamThatLastsIsNoSlowCall) {
  serve(0, 3600);
  ASSERT_TRUE(server->create(uniform_scene("s")).ok());
  Toucher toucher(server->channel(), "s");
  ASSERT_TRUE(toucher.opened());
  EXPECT_TRUE(toucher.finish().ok());
  EXPECT_TRUE(told("teletact.v1.Palpation/Touch").empty());
}

}  // namespace
}  // namespace teletact::service
