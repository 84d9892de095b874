#include "bench/load/recorded_finger.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "bench/load/arrivals.h"
#include "client/link/recording.h"

namespace teletact::bench {
namespace {

void copy_to(const google::protobuf::RepeatedField<double>& from, std::array<double, 3>& to) {
  std::copy_n(from.begin(), std::min<int>(from.size(), 3), to.begin());
}

}  // namespace

std::shared_ptr<const RecordedTouch> read_recorded_touch(const std::string& path) {
  client::RecordReader reader(path);
  if (reader.header().kind() != "touch")
    throw std::runtime_error(path +
                             ": not a recording of a touch; give the file of teletact-client touch --record");
  auto touch = std::make_shared<RecordedTouch>();
  touch->scene_id = reader.header().scene_id();
  std::int64_t first_ns = 0;
  while (const auto entry = reader.next()) {
    const v1::TouchRequest& request = entry->touch_request();
    if (request.has_open() && touch->poses.empty()) touch->open = request.open();
    if (!request.has_pose()) continue;
    if (touch->poses.empty()) first_ns = entry->monotonic_ns();
    RecordedTouch::Pose pose;
    pose.time_s = 1e-9 * static_cast<double>(entry->monotonic_ns() - first_ns);
    if (!touch->poses.empty()) pose.time_s = std::max(pose.time_s, touch->poses.back().time_s);
    copy_to(request.pose().position_m(), pose.position_m);
    copy_to(request.pose().velocity_m_s(), pose.velocity_m_s);
    touch->poses.push_back(pose);
  }
  if (touch->poses.size() < 2 || !(touch->poses.back().time_s > 0))
    throw std::runtime_error(path + ": holds no poses to be sent again; touch again with --record");
  const double last_s = touch->poses.back().time_s;
  touch->length_s = last_s + last_s / static_cast<double>(touch->poses.size() - 1);
  return touch;
}

RecordedFinger::RecordedFinger(std::shared_ptr<const RecordedTouch> touch, unsigned client)
    : touch_(std::move(touch)), ahead_s_(phase_of(client) * touch_->length_s) {
  while (touch_->poses[next_].time_s < ahead_s_ && ++next_ < touch_->poses.size()) {
  }
}

double RecordedFinger::next() {
  const std::size_t round = next_ / touch_->poses.size(), pose = next_ % touch_->poses.size();
  ++next_;
  return static_cast<double>(round) * touch_->length_s + touch_->poses[pose].time_s - ahead_s_;
}

const RecordedTouch::Pose& RecordedFinger::at(double time_s) const {
  const auto& poses = touch_->poses;
  const double in_round_s = std::fmod(std::max(time_s + ahead_s_, 0.0), touch_->length_s);
  const auto after =
      std::lower_bound(poses.begin(), poses.end(), in_round_s,
                       [](const RecordedTouch::Pose& pose, double s) { return pose.time_s < s; });
  if (after == poses.end())
    return touch_->length_s - in_round_s < in_round_s - poses.back().time_s ? poses.front() : poses.back();
  if (after == poses.begin()) return *after;
  return after->time_s - in_round_s < in_round_s - (after - 1)->time_s ? *after : *(after - 1);
}

}  // namespace teletact::bench
