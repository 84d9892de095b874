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

std::string hex(const TraceId&);  // 32 digits, small

// Of a call with this header `traceparent`, which a peer has sent. One that is malformed, or absent, begins a
// trace of its own: one that was not given before by this process, and hardly by any other.
TraceId trace_of(std::optional<std::string_view> traceparent);

}  // namespace teletact::service
