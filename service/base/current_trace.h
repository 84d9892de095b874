// The trace of what this thread works on. It goes with the job that the thread posts to another.
#pragma once

#include <utility>

#include "service/base/trace_context.h"

namespace teletact::service {

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
