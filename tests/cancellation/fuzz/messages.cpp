#include "tests/cancellation/fuzz/messages.h"

#include <limits>

#include "teletact/v1/palpation.pb.h"
#include "tests/cancellation/fuzz/estimate_messages.h"
#include "tests/cancellation/fuzz/observe_messages.h"

namespace teletact::test {

Message constant(std::string bytes, std::size_t after_answers) {
  return {[bytes = std::move(bytes)](std::uint64_t) { return bytes; }, after_answers};
}

Message constant(const google::protobuf::MessageLite& message) {
  return constant(message.SerializeAsString());
}

std::string odd_name(Random& random) {
  switch (random.below(4)) {
    case 0:
      return "no-such-scene";
    case 1:
      return "../../etc/passwd";
    case 2:
      return std::string(100'000, 'x');
    default:
      return std::string("\0\n\"", 3);
  }
}

namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::size_t kMaxMessageBytes = 2 << 20;  // the service's

double odd_number(Random& random) {
  return random.one_of(std::array{kNan, kInfinity, -kInfinity, -1.0, 0.0, 1e-300, 1e300});
}

// --- touch -------------------------------------------------------------------------------------------------

v1::TouchOpen touch_open(const std::string& scene, Random& random) {
  v1::TouchOpen open;
  open.set_scene_id(scene);
  open.set_credit(static_cast<unsigned>(random.below(257)));
  if (random.chance(0.5)) open.set_period_s(random.within(0.0005, 0.01));
  if (random.chance(0.3)) open.mutable_layer()->set_depth_m(random.within(0, 0.015));
  if (random.chance(0.5)) open.set_path(static_cast<v1::SolvePath>(random.below(7)));
  if (random.chance(0.5)) {
    open.mutable_fingertip()->set_shape(static_cast<v1::FingertipShape>(random.below(4)));
    open.mutable_fingertip()->set_stuck(random.chance(0.3));
  }
  if (random.chance(0.5)) open.set_session_id("session-" + std::to_string(random.below(4)));
  if (random.chance(0.3)) open.mutable_tolerance()->set_relative(random.within(0, 1));
  open.set_laws(random.chance(0.5));
  open.set_pressure(random.chance(0.3));
  return open;
}

v1::ContactPose touch_pose(std::uint64_t sequence, Random& random) {
  v1::ContactPose pose;
  pose.set_sequence(sequence);
  pose.add_position_m(random.within(-0.01, 0.06));
  pose.add_position_m(random.within(-0.005, 0.005));
  if (random.chance(0.3)) pose.add_position_m(0);
  return pose;
}

Message open_message(const v1::TouchOpen& open) {
  v1::TouchRequest request;
  *request.mutable_open() = open;
  return constant(request);
}

Message pose_message(v1::ContactPose pose, std::size_t after_answers) {
  v1::TouchRequest request;
  *request.mutable_pose() = std::move(pose);
  return {[request](std::uint64_t newest) mutable {
            if (request.pose().acknowledged() == 0) request.mutable_pose()->set_acknowledged(newest);
            return request.SerializeAsString();
          },
          after_answers};
}

Message hand_over_message(const std::string& session) {
  v1::TouchRequest request;
  request.mutable_hand_over()->set_session_id(session);
  return constant(request);
}

void spoil(v1::TouchOpen& open, Random& random) {
  switch (random.below(8)) {
    case 0:
      return open.set_scene_id(odd_name(random));
    case 1:
      return open.set_credit(random.chance(0.5) ? 257 : 0xffffffffU);
    case 2:
      return open.set_period_s(odd_number(random));
    case 3:
      return open.mutable_fingertip()->set_radius_m(odd_number(random));
    case 4:
      return open.mutable_fingertip()->set_shape(static_cast<v1::FingertipShape>(77));
    case 5:
      return open.set_path(static_cast<v1::SolvePath>(-77));
    case 6:
      return open.mutable_layer()->set_depth_m(odd_number(random));
    default:
      return open.set_session_id(std::string(100'000, '\n'));
  }
}

void spoil(v1::ContactPose& pose, Random& random) {
  switch (random.below(6)) {
    case 0:
      return pose.set_position_m(static_cast<int>(random.below(2)), odd_number(random));
    case 1:
      return pose.mutable_position_m()->Resize(random.chance(0.5) ? 1 : 30'000, 0.01);
    case 2:
      return pose.mutable_velocity_m_s()->Resize(static_cast<int>(random.below(5)), odd_number(random));
    case 3:
      return pose.set_sequence(0);
    case 4:
      return pose.set_acknowledged(random.chance(0.5) ? 7 : std::numeric_limits<std::uint64_t>::max());
    default:
      return pose.clear_position_m();
  }
}

Script touch(const Case& tried, const std::string& scene, Random& random) {
  Script script;
  auto& messages = script.messages;
  v1::TouchOpen open = touch_open(scene, random);
  const bool invalid = tried.content == Content::kInvalid;
  const bool bad_open = invalid && random.chance(0.4);
  if (bad_open) spoil(open, random);
  if (!(invalid && random.chance(0.1))) messages.push_back(open_message(open));  // or a pose comes first
  if (invalid && random.chance(0.1)) messages.push_back(open_message(open));
  if (tried.content == Content::kEmpty) {
    if (random.chance(0.5)) messages.clear();
    messages.push_back(constant(std::string()));
    return script;
  }
  const std::size_t poses = random.below(8);
  const bool waits = random.chance(0.7);  // for each answer, as a servo's client does in effect
  for (std::size_t k = 1; k <= poses; ++k) {
    v1::ContactPose pose = touch_pose(k, random);
    if (invalid && !bad_open && k == poses) spoil(pose, random);
    messages.push_back(pose_message(std::move(pose), waits ? k : 0));
    if (random.chance(0.1))
      messages.push_back(hand_over_message("session-" + std::to_string(random.below(5))));
  }
  return script;
}

// --- watch -------------------------------------------------------------------------------------------------

Script watch(const Case& tried, const std::string& scene, Random& random) {
  Script script;
  v1::WatchFingerRequest first;
  first.set_scene_id(scene);
  const auto acknowledging = [](std::uint64_t offset) {
    return Message{[offset](std::uint64_t newest) {
                     v1::WatchFingerRequest request;
                     request.set_acknowledged(newest + offset);
                     return request.SerializeAsString();
                   },
                   1};
  };
  if (tried.content == Content::kEmpty) {
    if (random.chance(0.5)) script.messages.push_back(constant(first));
    script.messages.push_back(constant(std::string()));
    return script;
  }
  if (tried.content == Content::kInvalid) {
    switch (random.below(3)) {
      case 0:
        first.set_scene_id(odd_name(random));
        script.messages.push_back(constant(first));
        return script;
      case 1:
        script.messages = {constant(first), acknowledging(random.chance(0.5) ? 1 : std::uint64_t{1} << 63)};
        return script;
      default:  // acknowledged before it names the scene
        script.messages = {acknowledging(0)};
        script.messages[0].after_answers = 0;
        return script;
    }
  }
  script.messages = {constant(first), acknowledging(0)};
  script.repeats_last = true;
  return script;
}

// --- scenes ------------------------------------------------------------------------------------------------

v1::CreateSceneRequest create_request(const Targets& targets, Random& random) {
  constexpr int kColumns = 10, kRows = 6;
  v1::CreateSceneRequest request;
  if (random.chance(0.9)) request.set_scene_id(random.one_of(targets.made));
  request.mutable_geometry()->add_size_m(0.05);
  request.mutable_geometry()->add_size_m(0.03);
  if (random.chance(0.05)) return request;  // an empty one, to publish into
  v1::ModulusMap& map = *request.mutable_modulus();
  for (int i = 0; i <= kColumns; ++i) map.add_x_m(0.05 * i / kColumns);
  for (int j = 0; j <= kRows; ++j) map.add_y_m(0.03 * j / kRows);
  const std::vector<float> pa(static_cast<std::size_t>(kColumns * kRows), 10e3F);
  v1::Array& array = *map.mutable_youngs_modulus_pa();
  array.set_dtype(v1::DATA_TYPE_FLOAT32);
  array.add_shape(kRows);
  array.add_shape(kColumns);
  array.set_data(pa.data(), pa.size() * sizeof(float));
  return request;
}

void spoil(v1::CreateSceneRequest& request, Random& random) {
  v1::ModulusMap& map = *request.mutable_modulus();
  switch (random.below(10)) {
    case 0:
      return request.set_scene_id(odd_name(random));
    case 1:
      return request.mutable_geometry()->set_size_m(0, odd_number(random));
    case 2:
      return request.mutable_geometry()->mutable_size_m()->Resize(static_cast<int>(random.below(5)), 1e9);
    case 3:
      return request.mutable_geometry()->set_poisson_ratio(random.chance(0.5) ? 0.5 : kNan);
    case 4:
      return request.mutable_geometry()->set_thickness_m(odd_number(random));
    case 5:
      return (random.chance(0.5) ? map.mutable_x_m() : map.mutable_z_m())
          ->Resize(static_cast<int>(random.below(5)), odd_number(random));
    case 6:
      return map.mutable_youngs_modulus_pa()->add_shape(0xffffffffU);
    case 7:
      return map.mutable_youngs_modulus_pa()->mutable_data()->resize(random.below(1000));
    case 8:
      return map.mutable_youngs_modulus_pa()->set_dtype(static_cast<v1::DataType>(random.below(257)));
    default:
      map.mutable_x_m()->Resize(70'000, 0.01);
      return request.mutable_geometry()->mutable_supports()->set_z_min(random.chance(0.5));
  }
}

Script create(const Case& tried, const Targets& targets, Random& random) {
  v1::CreateSceneRequest request = create_request(targets, random);
  if (tried.content == Content::kInvalid) spoil(request, random);
  return {{constant(request)}, false};
}

Script get_scene(const Case& tried, const Targets& targets, Random& random) {
  v1::GetSceneRequest request;
  const bool full = tried.method == Method::kGetSceneFull;
  request.set_scene_id(full && !targets.large.empty() ? targets.large : random.one_of(targets.touched));
  request.set_view(full ? v1::SCENE_VIEW_FULL : v1::SCENE_VIEW_BASIC);
  if (tried.content == Content::kInvalid) {
    if (random.chance(0.5))
      request.set_scene_id(odd_name(random));
    else
      request.set_view(static_cast<v1::SceneView>(77));
  }
  return {{constant(request)}, false};
}

Script delete_scene(const Case& tried, const Targets& targets, Random& random) {
  v1::DeleteSceneRequest request;
  request.set_scene_id(tried.content == Content::kInvalid ? odd_name(random) : random.one_of(targets.made));
  return {{constant(request)}, false};
}

// --- health, and what has no fields ------------------------------------------------------------------------

// HealthCheckRequest{service = 1}, by hand: Debian has no generated code of it.
Script health(const Case& tried, Random& random) {
  const std::string service =
      tried.content == Content::kInvalid ? odd_name(random).substr(0, 100) : "teletact.v1.Palpation";
  return {{constant(std::string("\x0a") + static_cast<char>(service.size()) + service)}, false};
}

// An unknown field of 100 kB: valid for proto3.
Script fieldless(const Case& tried) {
  std::string bytes;
  if (tried.content == Content::kInvalid) bytes.assign("\xfa\x01\xa0\x8d\x06", 5).append(100'000, 'x');
  return {{constant(bytes)}, false};
}

Script broken(const Script& valid, Method method, Random& random) {
  Script script;
  if (!sends_one(method) && !valid.messages.empty() && random.chance(0.5))
    script.messages.push_back(valid.messages.front());  // it becomes broken later
  if (random.chance(0.02))
    script.messages.push_back(constant(std::string(kMaxMessageBytes + 1, '\0')));
  else if (random.chance(0.8))
    script.messages.push_back(constant(std::string("\xff\xff\xff")));
  return script;
}

Script whole_script(const Case& tried, const Targets& targets, Random& random) {
  switch (tried.method) {
    case Method::kEstimate:
      return estimate_script(tried, random.one_of(targets.touched), random);
    case Method::kCreateScene:
      return create(tried, targets, random);
    case Method::kGetSceneBasic:
    case Method::kGetSceneFull:
      return get_scene(tried, targets, random);
    case Method::kDeleteScene:
      return delete_scene(tried, targets, random);
    case Method::kTouch:
      return touch(tried, random.one_of(targets.touched), random);
    case Method::kWatchFinger:
      return watch(tried, random.one_of(targets.touched), random);
    case Method::kObserve:
      return observe_script(tried, random.one_of(targets.touched), random);
    case Method::kHealthCheck:
    case Method::kHealthWatch:
      return health(tried, random);
    case Method::kGetInfo:
    case Method::kListScenes:
      return fieldless(tried);
  }
  return {};
}

}  // namespace

Script script_for(const Case& tried, const Targets& targets, Random& random) {
  if (tried.content == Content::kEmpty && sends_one(tried.method)) return {{constant(std::string())}, false};
  Script script = whole_script(tried, targets, random);
  return tried.content == Content::kBroken ? broken(script, tried.method, random) : script;
}

Script script_of_holder(Method method, const std::string& scene) {
  Random random(1);
  Case holder{method, ServiceState::kServing, End::kCancel, Content::kValid};
  if (method == Method::kEstimate) {
    Script script = estimate_script(holder, scene, random);
    script.messages.resize(1);
    return script;
  }
  if (method == Method::kWatchFinger) return watch(holder, scene, random);
  if (method == Method::kObserve) return observe_script(holder, scene, random);
  return {{open_message(touch_open(scene, random))}, false};
}

std::uint64_t number_in(Method method, const std::string& answer) {
  if (method == Method::kTouch) {
    v1::TouchResponse response;
    response.ParseFromString(answer);
    return response.answer().answer();
  }
  if (method == Method::kWatchFinger) {
    v1::FingerState state;
    state.ParseFromString(answer);
    return state.state();
  }
  if (method == Method::kObserve) {
    v1::Observation state;
    state.ParseFromString(answer);
    return state.state();
  }
  return 0;
}

}  // namespace teletact::test
