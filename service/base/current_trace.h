// The trace of what this thread works on. It goes with the job that the thread posts to another.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace teletact::service {

// Which trace a call belongs to, by W3C's Trace Context: https://www.w3.org/TR/trace-context/.
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

TraceId current_trace();

// While it lives, this thread works for that trace.
class InTrace {
 public:
  explicit InTrace(const TraceId&);
  ~InTrace();
  InTrace(const InTrace&) = delete;
  InTrace& operator=(const InTrace&) = delete;

 private:
  const TraceId before_;
};

// `work`, for the trace of who calls this, on whatever thread it is done.
template <class Work>
auto in_current_trace(Work work) {
  return [trace = current_trace(), work = std::move(work)](auto&&... given) {
    const InTrace here(trace);
    return work(std::forward<decltype(given)>(given)...);
  };
}

}  // namespace teletact::service
