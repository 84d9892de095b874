// A scene to touch on a running service, and what a touch recording says.
#pragma once

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "client/haptic/profiles.h"
#include "client/link/arrival_intervals.h"
#include "client/link/channel.h"
#include "client/link/recording.h"
#include "client/servo/states.h"
#include "teletact/v1/palpation.grpc.pb.h"
#include "tests/integration/process.h"
#include "tests/support/clock.h"
#include "tests/support/finger_reader.h"

namespace teletact::test {

// A finger that sweeps over most of it, 4 mm deep.
inline std::vector<std::string> touch_command(const std::string& address, const std::string& scene_id,
                                              const std::string& record, const std::string& renderer) {
  std::vector<std::string> command{client_binary(), "touch", "--service", address, "--scene", scene_id};
  for (const char* word :
       {"--wait-s", "60", "--begin-m", "0.03", "--end-m", "0.09", "--indentation-m", "0.004"})
    command.emplace_back(word);
  command.insert(command.end(), {"--renderer", renderer, "--record", record});
  return command;
}

// 120 x 40 mm of 10 kPa, touchable at once.
inline void create_touched_scene(const std::string& address, const std::string& scene_id) {
  v1::CreateSceneRequest request;
  request.set_scene_id(scene_id);
  request.mutable_geometry()->add_size_m(0.12);
  request.mutable_geometry()->add_size_m(0.04);
  constexpr int kColumns = 120, kRows = 40;
  v1::ModulusMap& map = *request.mutable_modulus();
  for (int i = 0; i <= kColumns; ++i) map.add_x_m(0.12 * i / kColumns);
  for (int j = 0; j <= kRows; ++j) map.add_y_m(0.04 * j / kRows);
  const std::vector<double> modulus(kColumns * kRows, 10e3);
  v1::Array& array = *map.mutable_youngs_modulus_pa();
  array.set_dtype(v1::DATA_TYPE_FLOAT64);
  array.add_shape(kRows);
  array.add_shape(kColumns);
  array.set_data(std::string(reinterpret_cast<const char*>(modulus.data()), modulus.size() * sizeof(double)));
  const auto stub = v1::Palpation::NewStub(client::make_channel(address));
  grpc::ClientContext context;
  v1::Scene scene;
  const grpc::Status status = stub->CreateScene(&context, request, &scene);
  if (!status.ok()) throw std::runtime_error(client::describe(status));
}

// True once the finger of the scene is deeper than `depth_m`, within `seconds`.
inline bool finger_presses(const std::string& address, const std::string& scene_id, double depth_m,
                           double seconds) {
  const auto stub = v1::Palpation::NewStub(client::make_channel(address));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() +
                       std::chrono::milliseconds(static_cast<int>(seconds * 1e3)));
  FingerReader reader(*stub, context, scene_id);
  for (v1::FingerState state; reader.read(&state);)
    if (state.present() && state.position_m_size() > 1 && state.position_m(1) > depth_m) {
      context.TryCancel();
      return true;
    }
  return false;
}

struct TouchTick {
  double time_s, y_m, force_n[2];
  client::ServoState state;
  double silence_s, model_age_s;
  bool degraded, faded;
  double expected_s = 0;  // to the next answer, by those that had come
  double size_n() const { return std::hypot(force_n[0], force_n[1]); }
  // Beyond what the finger itself pressed in, at the device's stiffness cap.
  double rise_n(const TouchTick& before) const {
    const double cap_n_m = client::device_profile("premium-1.5").largest_stiffness_n_m;
    return size_n() - before.size_n() - cap_n_m * std::max(y_m - before.y_m, 0.0);
  }
};

struct TouchRecording {
  struct Answer {
    double received_s, age_s;  // age: since its pose was sampled
    std::uint64_t sequence;
    double expected_s;  // from it to the next
  };
  struct Pose {
    std::uint32_t call;  // of which stream
    double sent_s;
    std::uint64_t in_flight;  // unanswered poses of its stream, itself included
  };
  std::vector<TouchTick> ticks;
  std::vector<Answer> answers;
  std::vector<Pose> poses;
  // The first answer received at or after `time_s`; infinity when there is none.
  double answer_after_s(double time_s) const {
    for (const Answer& answer : answers)
      if (answer.received_s >= time_s) return answer.received_s;
    return INFINITY;
  }
};

inline TouchRecording read_touch_recording(const std::string& path) {
  TouchRecording recording;
  client::RecordReader reader(path);
  std::uint64_t answered = 0, sent = 0;
  client::ArrivalIntervals arrivals;
  while (const auto entry = reader.next()) {
    const double time_s = 1e-9 * static_cast<double>(entry->monotonic_ns());
    if (entry->has_servo()) {
      const v1::ServoSample& s = entry->servo();
      recording.ticks.push_back({time_s,
                                 s.position_m(1),
                                 {s.force_n(0), s.force_n(1)},
                                 static_cast<client::ServoState>(s.state()),
                                 s.silence_s(),
                                 s.model_age_s(),
                                 s.degraded(),
                                 s.faded()});
    }
    if (entry->has_touch_request() && entry->touch_request().has_open()) answered = sent;
    if (entry->has_touch_request() && entry->touch_request().has_pose()) {
      sent = entry->touch_request().pose().sequence();
      recording.poses.push_back({entry->call(), time_s, sent - answered});
    }
    if (entry->has_touch_response() && entry->touch_response().has_opened()) {
      arrivals = {};
      arrivals.add(entry->monotonic_ns());
    }
    if (entry->has_touch_response() && entry->touch_response().has_answer()) {
      const v1::TouchAnswer& answer = entry->touch_response().answer();
      answered = std::max(answered, answer.sequence());
      const double posed_s = 1e-9 * static_cast<double>(answer.pose_stamp().monotonic_ns());
      arrivals.add(entry->monotonic_ns());
      recording.answers.push_back({time_s, time_s - posed_s, answer.sequence(), arrivals.expected_s()});
    }
  }
  for (TouchTick& tick : recording.ticks) {  // the answer whose silence it counts
    const auto later = std::upper_bound(
        recording.answers.begin(), recording.answers.end(), tick.time_s - tick.silence_s + 1e-6,
        [](double time_s, const TouchRecording::Answer& answer) { return time_s < answer.received_s; });
    if (later != recording.answers.begin()) tick.expected_s = std::prev(later)->expected_s;
  }
  return recording;
}

}  // namespace teletact::test
