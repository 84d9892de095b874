#include "service/trace/otlp.h"

#include <nlohmann/json.hpp>

#include "service/limits/shown.h"

namespace teletact::service {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kInternal = 1, kServer = 2;  // SpanKind
constexpr int kError = 2;                  // Status.StatusCode
constexpr std::size_t kLongestError = 200;

Json text(const char* key, const std::string& value) {
  return {{"key", key}, {"value", {{"stringValue", value}}}};
}

// 64 bits are text in protobuf's JSON.
Json number(const char* key, std::int64_t value) {
  return {{"key", key}, {"value", {{"intValue", std::to_string(value)}}}};
}

struct Times {
  std::chrono::nanoseconds to_wall;
  std::string operator()(Span::Time at) const {
    return std::to_string((at.time_since_epoch() + to_wall).count());
  }
};

Json span_json(const TraceId& trace, SpanId id, SpanId parent, const std::string& name, int kind,
               Span::Time begin, Span::Time end, const Times& times) {
  Json out{{"traceId", hex(trace)}, {"spanId", hex(id)}};
  if (parent != 0) out["parentSpanId"] = hex(parent);
  out["name"] = name;
  out["kind"] = kind;
  out["startTimeUnixNano"] = times(begin);
  out["endTimeUnixNano"] = times(end);
  return out;
}

Json call_json(const Span& span, const Span::Call& call, const Times& times) {
  Json out = span_json(span.context.trace, span.context.span, span.context.parent,
                       std::string(call.method.service) + "/" + call.method.name, kServer, span.begin,
                       span.end, times);
  out["attributes"] = {text("rpc.system", "grpc"), text("rpc.service", call.method.service),
                       text("rpc.method", call.method.name), number("rpc.grpc.status_code", call.code)};
  out["status"] = Json::object();
  if (!call.error.empty()) out["status"] = {{"code", kError}, {"message", shown(call.error, kLongestError)}};
  return out;
}

}  // namespace

std::string otlp_line(const Span& span, const SpanSource& source, std::chrono::nanoseconds to_wall) {
  const Times times{to_wall};
  const TraceContext& context = span.context;
  Json spans = Json::array();
  spans.push_back(span.call ? call_json(span, *span.call, times)
                            : span_json(context.trace, context.span, context.parent, span.name, kInternal,
                                        span.begin, span.end, times));
  for (const Span::Stage& stage : span.stages)
    spans.push_back(span_json(context.trace, new_span_id(), context.span, stage.name, kInternal, stage.begin,
                              stage.end, times));
  Json scope{{"scope", {{"name", "teletact"}}}};
  scope["spans"] = std::move(spans);
  Json resource;
  resource["resource"]["attributes"] = {text("service.name", "teletact-service"),
                                        text("service.version", source.version),
                                        text("service.instance.id", source.instance)};
  resource["scopeSpans"] = Json::array({std::move(scope)});
  return Json{{"resourceSpans", Json::array({std::move(resource)})}}.dump() + "\n";
}

}  // namespace teletact::service
