#include "client/haptic/workspace.h"

#include <Eigen/LU>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace teletact::client {
namespace {

[[noreturn]] void refuse_axes(const std::string& axes, const std::string& why) {
  throw std::invalid_argument("axes: '" + axes + "' " + why +
                              "; name the device's axis that moves the finger along x, along y and along z, "
                              "with a minus where it goes the other way: x,y,z or z,y,-x");
}

// Row i: the device's axis that moves the finger along axis i of the scene.
Matrix3 axes_of(const std::string& axes) {
  Matrix3 rows = Matrix3::Zero();
  std::istringstream words(axes);
  int row = 0;
  for (std::string word; std::getline(words, word, ','); ++row) {
    const bool back = !word.empty() && word.front() == '-';
    const std::size_t axis = std::string("xyz").find(back ? word.substr(1) : word);
    if (row == 3 || word.size() != (back ? 2 : 1) || axis == std::string::npos)
      refuse_axes(axes, "is not three of x, y and z");
    rows(row, static_cast<Eigen::Index>(axis)) = back ? -1 : 1;
  }
  if (row != 3 || std::abs(rows.determinant()) != 1) refuse_axes(axes, "is not each of x, y and z once");
  if (rows.determinant() < 0)
    refuse_axes(axes, "is a mirror image, in which right is left: turn the sign of one of them");
  return rows;
}

// About y, which goes down: a device that stands turned to the left has its x to the left of the scene's
// depth. Seen from above x is to the right and z is up.
Matrix3 turned(double degrees) {
  const double angle = degrees * std::numbers::pi / 180, c = std::cos(angle), s = std::sin(angle);
  Matrix3 turn;
  turn << c, 0, -s, 0, 1, 0, s, 0, c;
  return turn;
}

// Validates before anything is made of them.
const WorkspaceOptions& checked(const WorkspaceOptions& options) {
  validate(options);
  return options;
}

}  // namespace

void validate(const WorkspaceOptions& options) {
  axes_of(options.axes);
  if (!(options.rotation_deg >= -180 && options.rotation_deg <= 180))
    throw std::invalid_argument("rotation_deg: give -180 to 180");
  if (!(options.scale >= 1 && options.scale <= 20))
    throw std::invalid_argument("scale: give 1 to 20 metres of the scene per metre of the device");
  if (!(options.force_scale >= 0.05 && options.force_scale <= options.scale))
    throw std::invalid_argument(
        "force_scale: give 0.05 to the scale of positions; beyond it the hand would be given more energy "
        "than the tissue holds");
  if (options.clutch_button > 32)
    throw std::invalid_argument("clutch_button: give a button of the device, 1 to 32, or 0 for none");
}

WorkspaceMap::WorkspaceMap(const WorkspaceOptions& options, const Vector3& start_m)
    : turn_(turned(checked(options).rotation_deg) * axes_of(options.axes)),
      scale_(options.scale),
      force_scale_(options.force_scale),
      start_m_(start_m) {
  restart();
}

void WorkspaceMap::restart() noexcept {
  device_m_ = scene_m_ = start_m_;
  unseen_m_.setZero();
  clutched_ = false;
}

Vector3 WorkspaceMap::place_of(const Vector3& device_m) const noexcept {
  return scene_m_ + scale_ * (turn_ * (device_m - device_m_));
}

Vector3 WorkspaceMap::force_at_hand(const Vector3& scene_n) const noexcept {
  return force_scale_ * (turn_.transpose() * scene_n);
}

void WorkspaceMap::map(DeviceReading& reading) noexcept {
  const Vector3 device_m = reading.pose.position_m;
  const Vector3 place_m = place_of(device_m), velocity_m_s = scale_ * (turn_ * reading.pose.velocity_m_s);
  reading.pose = {place_m, velocity_m_s};
  reading.unseen = {unseen_m_, Vector3::Zero()};
  // What is no number stays with the device and moves nothing.
  if (!device_m.allFinite() || !(reading.clutched || clutched_)) return;
  if (clutched_) unseen_m_ += place_m - scene_m_;
  device_m_ = device_m;
  if (!clutched_) scene_m_ = place_m;
  clutched_ = reading.clutched;
  reading.pose.position_m = scene_m_;
  reading.unseen.position_m = unseen_m_;
  if (clutched_) std::swap(reading.pose.velocity_m_s, reading.unseen.velocity_m_s);
}

DeviceProfile WorkspaceMap::in_scene(DeviceProfile device) const {
  const double stiffness = scale_ * force_scale_;  // at the hand, per that of the scene; damping and mass too
  device.largest_force_n /= force_scale_;
  device.largest_stiffness_n_m /= stiffness;
  device.largest_damping_n_s_m /= stiffness;
  device.workspace_radius_m *= scale_;
  device.apparent_mass_kg /= stiffness;
  device.friction_n /= force_scale_;
  device.resolution_m *= scale_;
  device.damping_n_s_m /= stiffness;
  device.metres_per_hand_m *= scale_;
  device.joules_per_hand_j *= scale_ / force_scale_;
  return device;
}

WorkspaceDevice::WorkspaceDevice(std::unique_ptr<HapticDevice> device, const WorkspaceOptions& options,
                                 const Vector3& start_m)
    : device_(std::move(device)), options_(options), map_(options, start_m), watch_(!options.without_noise) {}

void WorkspaceDevice::open() {
  device_->open();
  profile_ = map_.in_scene(device_->profile());
  map_.restart();
  watch_.restart();
  freshness_ = Freshness::kFresh;
  under_force_ = false;
  reach_due_ = true;
}

bool WorkspaceDevice::is_frozen(std::int64_t now_ns, const DeviceReading& raw) noexcept {
  FreshnessSample sample;
  sample.position_m = raw.pose.position_m;
  if (raw.velocity_stated) sample.velocity_m_s = raw.pose.velocity_m_s;
  sample.orientation = raw.orientation;
  sample.under_force = under_force_;
  const Freshness freshness = watch_.judge(now_ns, sample);
  if (freshness != freshness_ && freshness != Freshness::kFresh) found_ = freshness;
  freshness_ = freshness;
  return freshness != Freshness::kFresh;
}

bool WorkspaceDevice::read(std::int64_t now_ns, DeviceReading& reading) noexcept {
  DeviceReading raw;
  if (!device_->read(now_ns, raw)) return false;
  const bool by_button =
      options_.clutch_button > 0 && (raw.buttons >> (options_.clutch_button - 1) & 1U) != 0;
  raw.clutched = by_button || by_key_;
  raw.frozen = is_frozen(now_ns, raw);
  map_.map(raw);
  reading = raw;
  if (raw.clutched) {
    reach_due_ = true;
  } else if (const auto centre_m = device_->workspace_centre_m(); reach_due_ && centre_m) {
    reach_.put({map_.place_of(*centre_m), profile_.workspace_radius_m});
    reach_due_ = false;
  }
  return true;
}

bool WorkspaceDevice::write(const Vector3& force_n) noexcept {
  under_force_ = !force_n.isZero(0);
  return device_->write(map_.force_at_hand(force_n));
}

std::string WorkspaceDevice::trouble() {
  const Freshness found = found_.exchange(Freshness::kFresh);
  if (found == Freshness::kFresh) return device_->trouble();
  return "the device '" + profile_.name + "' is frozen: " + describe(found);
}

}  // namespace teletact::client
