// Spans as OpenTelemetry's protocol has them in JSON (OTLP/JSON): what the Collector's receiver otlpjsonfile
// reads, one message a line.
#pragma once

#include <chrono>
#include <string>

#include "service/trace/span.h"

namespace teletact::service {

// Whose spans they are.
struct SpanSource {
  std::string version, instance;  // of the program; of this process
};

// An ExportTraceServiceRequest with the span and its stages, and '\n' at its end. `to_wall`: what is added to
// the steady clock's times for nanoseconds since 1970. Text is printable ASCII, and at most 200 bytes of an
// error.
std::string otlp_line(const Span&, const SpanSource&, std::chrono::nanoseconds to_wall);

}  // namespace teletact::service
