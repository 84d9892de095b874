// What took so long, and when: a call, or one answer of a stream.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "service/trace/trace_context.h"

namespace teletact::service {

struct Method {
  const char *service, *name;  // "teletact.v1.Palpation", "Touch"
};

struct Span {
  using Time = std::chrono::steady_clock::time_point;
  struct Stage {
    const char* name;
    Time begin, end;
  };
  struct Call {
    Method method;
    int code;           // gRPC's
    std::string error;  // where the service failed, not its caller: why
  };
  TraceContext context;
  const char* name = "";  // of what is no call
  std::optional<Call> call = {};
  Time begin, end;
  std::vector<Stage> stages = {};  // its children
};

}  // namespace teletact::service
