#include "client/report/session_record.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

#include "client/clock/clock.h"
#include "client/link/recording.h"
#include "client/servo/states.h"
#include "client/text/shown.h"

namespace teletact::client {
namespace {

void require_kind(const RecordReader& reader, const std::string& path, const char* kind, const char* option) {
  if (reader.header().kind() != kind)
    throw std::runtime_error(path + ": a recording of '" + shown(reader.header().kind()) + "', not of '" +
                             kind + "'; give " + option + " the file of teletact-client " + kind +
                             " --record");
}

Finger finger_of(const v1::Fingertip& tip) {
  Finger finger;
  if (tip.shape() == v1::FINGERTIP_SHAPE_NODE) finger.shape = FingerShape::kNode;
  if (tip.shape() == v1::FINGERTIP_SHAPE_FLAT_PUNCH) finger.shape = FingerShape::kFlatPunch;
  if (tip.radius_m() > 0) finger.radius_m = tip.radius_m();
  if (tip.half_width_m() > 0) finger.half_width_m = tip.half_width_m();
  finger.footprint_m = tip.footprint_m();
  return finger;
}

TouchTick tick_of(const v1::ServoSample& sample, double time_s, double layer_depth_m) {
  if (sample.position_m_size() < 2 || sample.force_n_size() < 2)
    throw std::runtime_error("the touch recording holds a servo sample without position or force");
  TouchTick tick;
  tick.time_s = time_s;
  tick.x_m = sample.position_m(0);
  tick.indentation_m = sample.position_m(1) - layer_depth_m;
  tick.force_x_n = sample.force_n(0);
  tick.force_y_n = sample.force_n(1);
  if (sample.position_m_size() == 3) tick.z_m = sample.position_m(2);
  if (sample.force_n_size() == 3) tick.force_z_n = sample.force_n(2);
  tick.lateness_s = sample.lateness_s();
  // Clutched, nothing is meant to be felt; the ramp after it is as after any start.
  tick.enabled = sample.state() == static_cast<std::uint32_t>(ServoState::kEnabled) && !sample.clutched();
  tick.at_border = sample.at_border();
  if (sample.has_claim()) tick.refused = {static_cast<EnergyClaim>(sample.claim()), sample.claim_lacks_j()};
  if (sample.has_degraded()) tick.degraded = sample.degraded();
  if (sample.has_service_degraded()) tick.service_degraded = sample.service_degraded();
  if (sample.has_faded()) tick.faded = sample.faded();
  if (sample.has_by_law()) tick.by_law = sample.by_law();
  tick.round_trip_s = sample.round_trip_s();
  return tick;
}

void add_answer(const v1::TouchAnswer& answer, const v1::RecordEntry& entry, TouchRecord& record) {
  record.not_covered += answer.status() == v1::TOUCH_STATUS_NOT_COVERED;
  record.degraded += answer.status() == v1::TOUCH_STATUS_DEGRADED;
  record.model_version = std::max(record.model_version, answer.model_version());
  record.failed += answer.status() == v1::TOUCH_STATUS_FAILED;
  if (answer.position_m_size() < 2)
    throw std::runtime_error("the touch recording holds an answer without its pose");
  TouchAnswerTime& last = record.answers.emplace_back();
  last.arrived_s = seconds(entry.monotonic_ns());
  last.latency_s = seconds_between(answer.pose_stamp().monotonic_ns(), entry.monotonic_ns());
  last.x_m = answer.position_m(0), last.y_m = answer.position_m(1);
  if (answer.position_m_size() == 3) last.z_m = answer.position_m(2);
  if (answer.force_n_size() == 3) std::copy_n(answer.force_n().begin(), 3, last.force_n.begin());
  if (answer.has_budget()) last.stated = {answer.budget().half_width(), answer.budget().above()};
  if (!answer.has_tactile()) return;
  if (auto image = tactile_from(answer.tactile()))
    record.tactile.push_back({last.arrived_s, std::move(*image)});
  else
    ++record.malformed_images;
}

}  // namespace

TouchRecord read_touch_record(const std::string& path) {
  RecordReader reader(path);
  require_kind(reader, path, "touch", "--touch-record");
  TouchRecord record;
  record.scene_id = reader.header().scene_id();
  while (const auto entry = reader.next()) {
    if (entry->has_touch_request() && entry->touch_request().has_open()) {
      const v1::TouchOpen& open = entry->touch_request().open();
      record.finger = finger_of(open.fingertip());
      if (open.fingertip().shape() == v1::FINGERTIP_SHAPE_PAD ||
          open.fingertip().shape() == v1::FINGERTIP_SHAPE_SPHERE)
        record.untold = path + ": touched with a pad or a sphere; the true force is known for other tips";
      if (open.fingertip().stuck())
        record.untold =
            path + ": touched with a sticking tip; the true force is known for a frictionless one";
    }
    if (entry->has_touch_response() && entry->touch_response().has_opened()) {
      record.layer_depth_m = entry->touch_response().opened().layer().depth_m();
      record.instances.insert(entry->touch_response().opened().instance());
    }
    if (entry->has_touch_response() && entry->touch_response().has_answer())
      add_answer(entry->touch_response().answer(), *entry, record);
    if (entry->has_servo())
      record.ticks.push_back(tick_of(entry->servo(), seconds(entry->monotonic_ns()), record.layer_depth_m));
  }
  if (record.ticks.empty())
    throw std::runtime_error(path + ": holds no servo samples; touch again with --record");
  return record;
}

AcquireRecord read_acquire_record(const std::string& path) {
  RecordReader reader(path);
  require_kind(reader, path, "acquire", "--acquire-record");
  AcquireRecord record;
  record.scene_id = reader.header().scene_id();
  std::map<std::uint32_t, double> received_to_published_s;  // by call
  while (const auto entry = reader.next()) {
    if (entry->has_estimate_response() && entry->estimate_response().has_summary())
      received_to_published_s[entry->call()] = entry->estimate_response().summary().received_to_published_s();
    if (entry->has_window()) {
      const v1::WindowTiming& timing = entry->window();
      if (timing.window().origin_m().empty())
        throw std::runtime_error(path + ": holds a window without its place");
      const auto& origin_m = timing.window().origin_m();
      double& received_s = received_to_published_s[entry->call()];
      if (received_s == 0)  // a slice is published by a call of its own
        received_s = seconds_between(timing.last_byte_ns(), timing.published_ns());
      record.windows.push_back({origin_m[0], seconds(timing.published_ns()),
                                seconds_between(timing.asked_ns(), timing.published_ns()), received_s,
                                origin_m.size() > 2 ? origin_m[2] : 0});
    }
    if (entry->has_scene()) record.scene = entry->scene();
    if (entry->has_info()) record.info = entry->info();
  }
  return record;
}

std::optional<ForceInterval> stated_interval(const TouchRecord& touch, const TouchTick& tick) {
  constexpr double kSameTouchM = 0.002;  // an answer's place, and where it is felt
  const auto after = std::ranges::upper_bound(touch.answers, tick.time_s, {}, &TouchAnswerTime::arrived_s);
  if (after == touch.answers.begin()) return std::nullopt;
  const TouchAnswerTime& answer = *(after - 1);
  if (std::hypot(answer.x_m - tick.x_m, answer.z_m - tick.z_m) > kSameTouchM) return std::nullopt;
  return answer.stated;
}

std::string session_mismatch(const TouchRecord& touch, const AcquireRecord& acquire) {
  if (touch.scene_id != acquire.scene_id)
    throw std::runtime_error("the recordings are of different scenes: " + shown(touch.scene_id) + " and " +
                             shown(acquire.scene_id));
  const double ended_s = touch.ticks.empty() ? 0 : touch.ticks.back().time_s;
  if (!acquire.windows.empty() &&
      std::all_of(acquire.windows.begin(), acquire.windows.end(),
                  [&](const AcquiredWindow& window) { return window.published_s > ended_s; }))
    throw std::runtime_error(
        "the recordings are not of one session: every window was published after the touch had ended; give "
        "the --acquire-record of what was touched");
  if (acquire.info && acquire.info->instance() != 0 && !touch.instances.empty() &&
      !touch.instances.contains(acquire.info->instance()))
    return "the recordings are of two runs of the service: are they of one session?";
  if (acquire.scene && touch.model_version > acquire.scene->version())
    return "the tissue that was touched is newer than what the acquisition's recording holds: are they of "
           "one "
           "session?";
  return "";
}

}  // namespace teletact::client
