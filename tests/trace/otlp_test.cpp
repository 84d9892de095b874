// A line is what OpenTelemetry's protocol says of an ExportTraceServiceRequest in JSON.
#include "service/trace/otlp.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

namespace teletact::service {
namespace {

using Json = nlohmann::json;
using std::chrono::milliseconds;

const SpanSource kSource{"0.1.0", "00000000000000ff"};
constexpr std::chrono::nanoseconds kToWall{1'700'000'000'000'000'000};
const Span::Time kBegin{std::chrono::seconds(5)};

std::map<std::string, std::string> attributes_of(const Json& owner) {
  std::map<std::string, std::string> out;
  for (const Json& attribute : owner.at("attributes"))
    out[attribute.at("key")] = attribute.at("value").begin()->get<std::string>();
  return out;
}

Json spans_of(const std::string& line) {
  EXPECT_EQ(std::count(line.begin(), line.end(), '\n'), 1);
  EXPECT_EQ(line.back(), '\n');
  const Json all = Json::parse(line);
  EXPECT_EQ(all.at("resourceSpans").size(), 1U);
  const Json& resource = all.at("resourceSpans").at(0);
  const auto said = attributes_of(resource.at("resource"));
  EXPECT_EQ(said.at("service.name"), "teletact-service");
  EXPECT_EQ(said.at("service.version"), "0.1.0");
  EXPECT_EQ(said.at("service.instance.id"), "00000000000000ff");
  EXPECT_EQ(resource.at("scopeSpans").size(), 1U);
  return resource.at("scopeSpans").at(0).at("spans");
}

TEST(Otlp, ACallWithItsStages) {
  const Span span{
      {{0x4bf92f3577b34da6, 0xa3ce929d0e0e4736}, 0xab, 0xf067aa0ba902b7},
      "",
      Span::Call{{"teletact.v1.Elastography", "Estimate"}, 14, "UNAVAILABLE: the \"device\"\nfailed"},
      kBegin,
      kBegin + milliseconds(1500),
      {{"upload", kBegin, kBegin + milliseconds(500)},
       {"modulus", kBegin + milliseconds(500), kBegin + milliseconds(1400)}}};
  const Json spans = spans_of(otlp_line(span, kSource, kToWall));
  ASSERT_EQ(spans.size(), 3U);
  const Json& call = spans.at(0);
  EXPECT_EQ(call.at("traceId"), "4bf92f3577b34da6a3ce929d0e0e4736");
  EXPECT_EQ(call.at("spanId"), "00000000000000ab");
  EXPECT_EQ(call.at("parentSpanId"), "00f067aa0ba902b7");
  EXPECT_EQ(call.at("name"), "teletact.v1.Elastography/Estimate");
  EXPECT_EQ(call.at("kind"), 2);
  EXPECT_EQ(call.at("startTimeUnixNano"), "1700000005000000000");
  EXPECT_EQ(call.at("endTimeUnixNano"), "1700000006500000000");
  EXPECT_EQ(attributes_of(call),
            (std::map<std::string, std::string>{{"rpc.system", "grpc"},
                                                {"rpc.service", "teletact.v1.Elastography"},
                                                {"rpc.method", "Estimate"},
                                                {"rpc.grpc.status_code", "14"}}));
  EXPECT_EQ(call.at("attributes").at(3).at("value").begin().key(), "intValue");
  EXPECT_EQ(call.at("status"), (Json{{"code", 2}, {"message", "UNAVAILABLE: the ?device??failed"}}));
  const char* const names[] = {"upload", "modulus"};
  for (std::size_t k = 0; k < 2; ++k) {
    const Json& stage = spans.at(k + 1);
    EXPECT_EQ(stage.at("name"), names[k]);
    EXPECT_EQ(stage.at("traceId"), call.at("traceId"));
    EXPECT_EQ(stage.at("parentSpanId"), call.at("spanId"));
    EXPECT_EQ(stage.at("spanId").get<std::string>().size(), 16U);
    EXPECT_NE(stage.at("spanId"), spans.at(2 - k).at("spanId"));
    EXPECT_EQ(stage.at("kind"), 1);
  }
  EXPECT_EQ(spans.at(1).at("endTimeUnixNano"), spans.at(2).at("startTimeUnixNano"));
}

TEST(Otlp, WithoutACallerNorAnError) {
  const Span span{
      {{1, 2}, 3, 0}, "", Span::Call{{"teletact.v1.Palpation", "GetScene"}, 0, ""}, kBegin, kBegin};
  const Json call = spans_of(otlp_line(span, kSource, kToWall)).at(0);
  EXPECT_FALSE(call.contains("parentSpanId"));
  EXPECT_EQ(call.at("status"), Json::object());
  const Span answer{{{1, 2}, 4, 3}, "touch answer", {}, kBegin, kBegin};
  const Json part = spans_of(otlp_line(answer, kSource, kToWall)).at(0);
  EXPECT_EQ(part.at("name"), "touch answer");
  EXPECT_EQ(part.at("kind"), 1);
  EXPECT_FALSE(part.contains("attributes"));
}

TEST(Otlp, WhateverAnErrorSaysIsOneShortLine) {
  std::string worst(1 << 20, '\xff');
  worst[1] = '\n', worst[2] = '\0', worst[3] = '"', worst[4] = '\\';
  const Span span{{{1, 2}, 3, 0}, "", Span::Call{{"s", "m"}, 13, worst}, kBegin, kBegin};
  const std::string line = otlp_line(span, kSource, kToWall);
  EXPECT_LT(line.size(), 2000U);
  spans_of(line);
}

}  // namespace
}  // namespace teletact::service
