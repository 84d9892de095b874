#include "tests/cancellation/fuzz/case.h"

#include <initializer_list>

namespace teletact::test {

namespace {

using grpc::StatusCode;

bool is_among(StatusCode code, std::initializer_list<StatusCode> codes) {
  for (const StatusCode one : codes)
    if (one == code) return true;
  return false;
}

// As the comments of proto/teletact/v1 list them, UNAVAILABLE (starting, draining) apart; and, of any call of
// ours, that more are open than the service's limits state.
bool is_listed(Method method, StatusCode code) {
  const bool ours = method != Method::kHealthCheck && method != Method::kHealthWatch;
  if (code == StatusCode::OK || (ours && code == StatusCode::RESOURCE_EXHAUSTED)) return true;
  switch (method) {
    case Method::kGetInfo:
    case Method::kListScenes:
      return false;
    case Method::kEstimate:
      return is_among(code,
                      {StatusCode::INVALID_ARGUMENT, StatusCode::NOT_FOUND, StatusCode::FAILED_PRECONDITION,
                       StatusCode::DEADLINE_EXCEEDED, StatusCode::ABORTED});
    case Method::kCreateScene:
      return is_among(code, {StatusCode::INVALID_ARGUMENT, StatusCode::ALREADY_EXISTS});
    case Method::kGetSceneBasic:
    case Method::kGetSceneFull:
    case Method::kDeleteScene:
    case Method::kHealthCheck:
      return code == StatusCode::NOT_FOUND;
    case Method::kTouch:
    case Method::kWatchFinger:
    case Method::kObserve:
      return is_among(code, {StatusCode::NOT_FOUND, StatusCode::INVALID_ARGUMENT, StatusCode::ABORTED,
                             StatusCode::DEADLINE_EXCEEDED});
    case Method::kHealthWatch:
      return false;
  }
  return false;
}

// What gRPC itself answers to bytes that are no message, before the service sees them.
bool is_of_grpc(Method method, StatusCode code) {
  if (code == StatusCode::RESOURCE_EXHAUSTED) return true;        // too long
  return sends_one(method) && code == StatusCode::UNIMPLEMENTED;  // so says the callback interface
}

}  // namespace

const char* name_of(Method method) {
  switch (method) {
    case Method::kGetInfo:
      return "GetInfo";
    case Method::kEstimate:
      return "Estimate";
    case Method::kCreateScene:
      return "CreateScene";
    case Method::kGetSceneBasic:
      return "GetScene, basic";
    case Method::kGetSceneFull:
      return "GetScene, full";
    case Method::kListScenes:
      return "ListScenes";
    case Method::kDeleteScene:
      return "DeleteScene";
    case Method::kTouch:
      return "Touch";
    case Method::kWatchFinger:
      return "WatchFinger";
    case Method::kObserve:
      return "Observe";
    case Method::kHealthCheck:
      return "health Check";
    case Method::kHealthWatch:
      return "health Watch";
  }
  return "?";
}

const char* name_of(ServiceState state) {
  switch (state) {
    case ServiceState::kStarting:
      return "starting";
    case ServiceState::kServing:
      return "serving";
    case ServiceState::kFull:
      return "full";
    case ServiceState::kDeleted:
      return "deleted";
    case ServiceState::kDraining:
      return "draining";
  }
  return "?";
}

const char* name_of(End end) {
  switch (end) {
    case End::kCancel:
      return "cancel";
    case End::kDeadline:
      return "deadline";
    case End::kHalfClose:
      return "half-close";
    case End::kReset:
      return "reset";
    case End::kNoRead:
      return "no read";
  }
  return "?";
}

const char* name_of(Content content) {
  switch (content) {
    case Content::kValid:
      return "valid";
    case Content::kInvalid:
      return "invalid";
    case Content::kEmpty:
      return "empty";
    case Content::kBroken:
      return "broken";
  }
  return "?";
}

const char* name_of(StatusCode code) {
  constexpr std::array kNames{
      "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
      "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
      "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
      "DATA_LOSS", "UNAUTHENTICATED"};
  const auto index = static_cast<std::size_t>(code);
  return index < kNames.size() ? kNames[index] : "?";
}

std::string name_of(const Case& tried) {
  return std::string(name_of(tried.method)) + ", " + name_of(tried.state) + ", " + name_of(tried.end) + ", " +
         name_of(tried.content);
}

const char* path_of(Method method) {
  switch (method) {
    case Method::kGetInfo:
      return "/teletact.v1.Info/GetInfo";
    case Method::kEstimate:
      return "/teletact.v1.Elastography/Estimate";
    case Method::kCreateScene:
      return "/teletact.v1.Palpation/CreateScene";
    case Method::kGetSceneBasic:
    case Method::kGetSceneFull:
      return "/teletact.v1.Palpation/GetScene";
    case Method::kListScenes:
      return "/teletact.v1.Palpation/ListScenes";
    case Method::kDeleteScene:
      return "/teletact.v1.Palpation/DeleteScene";
    case Method::kTouch:
      return "/teletact.v1.Palpation/Touch";
    case Method::kWatchFinger:
      return "/teletact.v1.Palpation/WatchFinger";
    case Method::kObserve:
      return "/teletact.v1.Palpation/Observe";
    case Method::kHealthCheck:
      return "/grpc.health.v1.Health/Check";
    case Method::kHealthWatch:
      return "/grpc.health.v1.Health/Watch";
  }
  return "";
}

bool sends_one(Method method) {
  return method != Method::kEstimate && method != Method::kTouch && method != Method::kWatchFinger &&
         method != Method::kObserve;
}

bool may_end_with(const Case& tried, StatusCode code) {
  if (is_listed(tried.method, code)) return true;
  if (tried.content == Content::kBroken && is_of_grpc(tried.method, code)) return true;
  const bool going = tried.state == ServiceState::kDraining;
  switch (code) {
    case StatusCode::UNAVAILABLE:  // gRPC's own, too, for a connection that is gone
      return going || tried.state == ServiceState::kStarting || tried.end == End::kReset;
    case StatusCode::CANCELLED:
      // A health Watch has no other end than its client's; what still runs when the drain's time is over is
      // cut.
      return going || tried.end == End::kCancel || tried.end == End::kNoRead ||
             tried.method == Method::kHealthWatch;
    case StatusCode::DEADLINE_EXCEEDED:
      return tried.end == End::kDeadline;
    default:
      return false;
  }
}

}  // namespace teletact::test
