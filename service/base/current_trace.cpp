#include "service/base/current_trace.h"

namespace teletact::service {
namespace {

thread_local TraceId current;

}  // namespace

TraceId current_trace() {
  return current;
}

InTrace::InTrace(const TraceId& trace) : before_(current) {
  current = trace;
}

InTrace::~InTrace() {
  current = before_;
}

}  // namespace teletact::service
