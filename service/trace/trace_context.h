// Which trace a call belongs to, by W3C's Trace Context: https://www.w3.org/TR/trace-context/.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace teletact::service {

// 128 bits; all zero: none.
struct TraceId {
  std::uint64_t high = 0, low = 0;
  explicit operator bool() const { return high != 0 || low != 0; }
  bool operator==(const TraceId&) const = default;
};
using SpanId = std::uint64_t;  // 0: none

std::string hex(const TraceId&);  // 32 digits, small
std::string hex(SpanId);          // 16 digits, small

// One that was not given before by this process, and hardly by any other; never 0.
SpanId new_span_id();

struct TraceContext {
  TraceId trace;
  SpanId span = 0;    // of the call itself
  SpanId parent = 0;  // of who called; 0: it said none
};

// Of a call with this header `traceparent`, which a peer has sent. One that is malformed, or absent, begins a
// trace of its own.
TraceContext trace_context_of(std::optional<std::string_view> traceparent);

}  // namespace teletact::service
