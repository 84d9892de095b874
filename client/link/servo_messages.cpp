#include "client/link/servo_messages.h"

#include <cmath>

#include "client/clock/clock.h"

namespace teletact::client {
namespace {

void add(const Vector3& vector, google::protobuf::RepeatedField<double>* xyz) {
  for (const double component : vector) xyz->Add(component);
}

// False: malformed.
template <class Message>
bool read_force(const Message& message, ForceSample& sample) {
  constexpr int kStride = 3;  // 3x3 row-major
  const auto force_n = vector_from(message.force_n());
  if (!force_n || message.tangent_n_m_size() != kStride * kStride) return false;
  sample.force_n = *force_n;
  for (int row = 0; row < kStride; ++row)
    for (int column = 0; column < kStride; ++column)
      sample.tangent_n_m(row, column) = message.tangent_n_m(kStride * row + column);
  return true;
}

}  // namespace

std::optional<Vector3> vector_from(const google::protobuf::RepeatedField<double>& xyz) {
  if (xyz.size() != 2 && xyz.size() != 3) return std::nullopt;
  return Vector3(xyz.Get(0), xyz.Get(1), xyz.size() == 3 ? xyz.Get(2) : 0);
}

std::optional<TouchedSurface> surface_from(const v1::Layer& layer) {
  constexpr double kRounding = 1e-6;
  TouchedSurface surface;
  if (layer.normal_size() > 0) {
    const auto normal = vector_from(layer.normal());
    if (!normal || !(std::abs(normal->norm() - 1) <= kRounding)) return std::nullopt;
    surface.normal = normal->normalized();
  }
  if (!std::isfinite(layer.depth_m())) return std::nullopt;
  surface.offset_m = surface.normal.y() * layer.depth_m();  // of its point below the origin
  return surface;
}

std::optional<Region> region_from(const v1::Region& region) {
  Region out;
  out.begin_x_m = region.begin_x_m();
  out.end_x_m = region.end_x_m();
  const auto ordered = [](double begin_m, double end_m) {
    return std::isfinite(begin_m) && std::isfinite(end_m) && begin_m <= end_m;
  };
  if (!ordered(out.begin_x_m, out.end_x_m)) return std::nullopt;
  if (!region.has_begin_z_m() || !region.has_end_z_m()) return out;
  out.begin_z_m = region.begin_z_m();
  out.end_z_m = region.end_z_m();
  return ordered(out.begin_z_m, out.end_z_m) ? std::optional(out) : std::nullopt;
}

std::optional<ServoAnswer> to_servo_answer(const v1::TouchAnswer& answer, const TouchedSurface& surface,
                                           double period_s, std::int64_t received_ns) {
  const auto region = region_from(answer.covered());
  const auto position_m = vector_from(answer.position_m());
  if (!region || !position_m) return std::nullopt;
  ServoAnswer out;
  out.received_ns = received_ns;
  out.period_s = period_s;
  out.region = *region;
  ForceSample& sample = out.sample;
  sample.sequence = answer.sequence();
  sample.model_version = answer.model_version();
  sample.solved_by = static_cast<std::uint32_t>(answer.path());
  sample.pose_time_s = seconds(answer.pose_stamp().monotonic_ns());
  sample.surface = surface;
  sample.position_m = *position_m;

  const v1::TouchStatus status = answer.status();
  out.has_force = status == v1::TOUCH_STATUS_OK || status == v1::TOUCH_STATUS_DEGRADED ||
                  status == v1::TOUCH_STATUS_NOT_COVERED;
  out.covered = status != v1::TOUCH_STATUS_NOT_COVERED;
  out.degraded = status == v1::TOUCH_STATUS_DEGRADED;
  if (!out.has_force || !out.covered) return out;
  const auto force_n = vector_from(answer.force_n());
  if (!force_n) return std::nullopt;
  sample.contact = !force_n->isZero(0);
  // Of the whole force at most; what is no number is believed to be right.
  constexpr double kOf95 = 1.96;
  double error = answer.solve().relative_force_error();
  for (const v1::ForceError& term : answer.budget().terms())
    if (term.term() == v1::ForceError::TERM_MODEL) error += kOf95 * term.relative();
  sample.relative_error = error > 0 ? std::min(error, 1.0) : 0;
  if (sample.contact) return read_force(answer, sample) ? std::optional(out) : std::nullopt;
  if (answer.has_foreseen()) {
    const v1::ForeseenTouch& foreseen = answer.foreseen();
    const auto light_m = vector_from(foreseen.position_m());
    if (!light_m || !read_force(foreseen, sample)) return std::nullopt;
    sample.position_m = *light_m;
    sample.foreseen = true;
  }
  return out;
}

v1::TouchRequest to_request(const ServoPose& pose, std::uint64_t sequence, std::uint64_t acknowledged,
                            std::uint64_t instance) {
  v1::TouchRequest request;
  v1::ContactPose& out = *request.mutable_pose();
  out.set_sequence(sequence);
  out.set_acknowledged(acknowledged);
  out.mutable_stamp()->set_monotonic_ns(pose.time_ns);
  out.mutable_stamp()->set_instance(instance);
  add(pose.pose.position_m, out.mutable_position_m());
  add(pose.pose.velocity_m_s, out.mutable_velocity_m_s());
  return request;
}

v1::RecordEntry to_record(const ServoTick& tick) {
  v1::RecordEntry entry;
  entry.set_monotonic_ns(tick.time_ns);
  v1::ServoSample& sample = *entry.mutable_servo();
  add(tick.pose.position_m, sample.mutable_position_m());
  add(tick.pose.velocity_m_s, sample.mutable_velocity_m_s());
  add(tick.force_n, sample.mutable_force_n());
  sample.set_state(static_cast<std::uint32_t>(tick.state));
  sample.set_lateness_s(tick.lateness_s);
  sample.set_sequence(static_cast<std::uint32_t>(tick.sequence));
  sample.set_at_border(tick.held_at_border);
  sample.set_model_age_s(tick.model_age_s);
  sample.set_silence_s(tick.silence_s);
  sample.set_round_trip_s(tick.round_trip_s);
  sample.set_clock_offset_s(tick.clock_offset_s);
  sample.set_modulus_age_s(tick.modulus_age_s);
  sample.set_reason(static_cast<std::uint32_t>(tick.reason));
  sample.set_degraded(tick.degraded);
  sample.set_indebted(tick.energy_generated);
  sample.set_service_degraded(tick.service_degraded);
  sample.set_by_law(tick.by_law);
  sample.set_faded(tick.faded);
  sample.set_clutched(tick.clutched);
  sample.set_stiffness_n_m(tick.stiffness_n_m);
  sample.set_stiffness_variance(tick.stiffness_variance);
  for (const double lateral : tick.lateral_stiffness_n_m) sample.add_lateral_stiffness_n_m(lateral);
  for (const double variance : tick.lateral_stiffness_variance)
    sample.add_lateral_stiffness_variance(variance);
  sample.set_gain(tick.gain);
  sample.set_energy_j(tick.energy_j);
  sample.set_stored_j(tick.stored_j);
  sample.set_damping_n_s_m(tick.damping_n_s_m);
  sample.set_withheld(tick.withheld);
  sample.set_balance_j(tick.balance_j);
  sample.set_claim(static_cast<std::uint32_t>(tick.refused.who));
  sample.set_claim_lacks_j(tick.refused.lacks_j);
  return entry;
}

}  // namespace teletact::client
