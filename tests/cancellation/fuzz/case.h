// What is tried: a call of the contract, in a state of the service, with messages of a kind, ended in a way.
// And what the service may answer: the codes that the contract lists for the call, and no other.
#pragma once

#include <grpcpp/support/status.h>

#include <array>
#include <compare>
#include <random>
#include <string>

namespace teletact::test {

enum class Method {
  kGetInfo,
  kEstimate,
  kCreateScene,
  kGetSceneBasic,
  kGetSceneFull,
  kListScenes,
  kDeleteScene,
  kTouch,
  kWatchFinger,
  kObserve,
  kHealthCheck,
  kHealthWatch,
};
enum class ServiceState { kStarting, kServing, kFull, kDeleted, kDraining };
enum class End { kCancel, kDeadline, kHalfClose, kReset, kNoRead };
enum class Content {
  kValid,
  kInvalid,  // a field is wrong
  kEmpty,    // a message of no bytes
  kBroken,   // bytes that are no message, too many bytes, or no message at all
};

inline constexpr std::array kMethods{Method::kGetInfo,       Method::kEstimate,     Method::kCreateScene,
                                     Method::kGetSceneBasic, Method::kGetSceneFull, Method::kListScenes,
                                     Method::kDeleteScene,   Method::kTouch,        Method::kWatchFinger,
                                     Method::kObserve,       Method::kHealthCheck,  Method::kHealthWatch};
inline constexpr std::array kStates{ServiceState::kStarting, ServiceState::kServing, ServiceState::kFull,
                                    ServiceState::kDeleted, ServiceState::kDraining};
inline constexpr std::array kEnds{End::kCancel, End::kDeadline, End::kHalfClose, End::kReset, End::kNoRead};
inline constexpr std::array kContents{Content::kValid, Content::kInvalid, Content::kEmpty, Content::kBroken};

struct Case {
  Method method = Method::kGetInfo;
  ServiceState state = ServiceState::kServing;
  End end = End::kCancel;
  Content content = Content::kValid;
  auto operator<=>(const Case&) const = default;
};

const char* name_of(Method);
const char* name_of(ServiceState);
const char* name_of(End);
const char* name_of(Content);
const char* name_of(grpc::StatusCode);
std::string name_of(const Case&);

// "/teletact.v1.Palpation/Touch"
const char* path_of(Method);
// The client sends one message and closes its side; the others go on until somebody ends them.
bool sends_one(Method);
bool may_end_with(const Case&, grpc::StatusCode);

// The same sequence for the same seed, whatever the machine.
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(engine_() % n); }
  double unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double within(double low, double high) { return low + (high - low) * unit(); }
  bool chance(double probability) { return unit() < probability; }
  template <class List>
  auto one_of(const List& list) {
    return *(std::begin(list) + static_cast<std::ptrdiff_t>(below(std::size(list))));
  }
  std::mt19937_64& engine() { return engine_; }

 private:
  std::mt19937_64 engine_;
};

}  // namespace teletact::test
