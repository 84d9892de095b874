#include "service/rpc/touch_messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "service/rpc/core.h"
#include "service/rpc/palpation_messages.h"

namespace teletact::service {

namespace {

constexpr std::array kShapes{v1::FINGERTIP_SHAPE_NODE, v1::FINGERTIP_SHAPE_FLAT_PUNCH,
                             v1::FINGERTIP_SHAPE_ROUNDED_TIP, v1::FINGERTIP_SHAPE_PAD,
                             v1::FINGERTIP_SHAPE_SPHERE};  // by FingertipShape
constexpr std::array kPaths{v1::SOLVE_PATH_UNSPECIFIED, v1::SOLVE_PATH_COMPLIANCE, v1::SOLVE_PATH_GRADIENTS,
                            v1::SOLVE_PATH_SHARES};  // by SolvePath
constexpr std::array kStatuses{v1::TOUCH_STATUS_OK, v1::TOUCH_STATUS_NOT_COVERED, v1::TOUCH_STATUS_DEGRADED,
                               v1::TOUCH_STATUS_FAILED, v1::TOUCH_STATUS_PREPARING};  // by TouchStatus
constexpr std::array kTerms{v1::ForceError::TERM_SOLVER,        v1::ForceError::TERM_MESH,
                            v1::ForceError::TERM_FINITE_STRAIN, v1::ForceError::TERM_MODULUS,
                            v1::ForceError::TERM_MODEL,         v1::ForceError::TERM_DIMENSION,
                            v1::ForceError::TERM_CONTEXT,       v1::ForceError::TERM_SLICES};  // by ErrorTerm
constexpr std::array kKinds{v1::ForceError::KIND_BOUND, v1::ForceError::KIND_ESTIMATE,
                            v1::ForceError::KIND_DEVIATION};  // by TermKind

// 0: `usual`.
double within(const char* field, double wished, double least, double most, double usual, const char* unit) {
  if (wished == 0) return usual;
  if (wished >= least && wished <= most) return wished;
  throw std::invalid_argument(fmt::format("{}: {} {} is not within [{}, {}]; leave it out for {}", field,
                                          wished, unit, least, most, usual));
}

void pad_from(const v1::Fingertip& in, Fingertip& tip) {
  tip.radius_m = 0.001;
  tip.half_width_m = 0.008;
  tip.pad_m_pa =
      within("open.fingertip.pad_thickness_m", in.pad_thickness_m(), 1e-4, 0.02, 0.002, "m") /
      within("open.fingertip.pad_youngs_modulus_pa", in.pad_youngs_modulus_pa(), 1e3, 1e8, 2e4, "Pa");
}

TaxelGrid taxels_from(const v1::TactileWish& in) {
  TaxelGrid grid;
  if (in.taxels_x() != 0) grid.along_x = in.taxels_x();
  if (in.taxels_z() != 0) grid.along_z = in.taxels_z();
  if (in.pitch_m() != 0) grid.pitch_m = in.pitch_m();
  return grid;
}

}  // namespace

TouchStreamOptions stream_options_from(const v1::TouchOpen& in) {
  TouchStreamOptions options{in.session_id(), in.credit(), in.period_s(), {}, in.laws(), in.pressure()};
  if (in.has_tactile()) options.tactile = taxels_from(in.tactile());
  TouchOptions& touch = options.touch;
  Fingertip& tip = touch.fingertip;
  if (in.fingertip().shape() != v1::FINGERTIP_SHAPE_UNSPECIFIED)
    tip.shape = value_from<FingertipShape>(
        kShapes, in.fingertip().shape(),
        "open.fingertip.shape: unknown; use NODE, FLAT_PUNCH, ROUNDED_TIP, PAD or SPHERE");
  if (tip.shape == FingertipShape::kPad) pad_from(in.fingertip(), tip);
  tip.friction = in.fingertip().stuck() ? Friction::kStuck : Friction::kFrictionless;
  if (in.fingertip().radius_m() != 0) tip.radius_m = in.fingertip().radius_m();
  if (in.fingertip().half_width_m() != 0) tip.half_width_m = in.fingertip().half_width_m();
  tip.footprint_m = in.fingertip().footprint_m();
  touch.layer_depth_m = in.layer().depth_m();
  if (in.layer().normal_size() > 0)
    touch.layer_normal = vector_from("open.layer.normal", in.layer().normal(), false);
  if (in.has_tolerance()) {
    const auto tolerance = [](const char* field, double value, double most) {
      if (value >= 0 && value <= most) return value;
      throw std::invalid_argument(
          fmt::format("open.tolerance.{}: {} is not within [0, {}]", field, value, most));
    };
    touch.tolerance = Tolerance{tolerance("relative", in.tolerance().relative(), 1),
                                tolerance("force_n", in.tolerance().force_n(), 100)};
  }
  touch.path = value_from<SolvePath>(
      kPaths, in.path(),
      "open.path: unknown, or no longer there; leave it out, or use COMPLIANCE, GRADIENTS or SHARES");
  return options;
}

FingerPose pose_from(const v1::ContactPose& in) {
  Vector3 position_m = vector_from("pose.position_m", in.position_m(), false);
  constexpr double kMinM = 1e-12;  // energies of less underflow, and errors relative to them are not finite
  for (double& x_m : position_m)
    if (std::abs(x_m) < kMinM) x_m = 0;
  return {in.sequence(),
          in.acknowledged(),
          position_m,
          vector_from("pose.velocity_m_s", in.velocity_m_s(), true),
          static_cast<std::size_t>(in.position_m_size()),
          in.stamp().monotonic_ns(),
          in.stamp().instance(),
          in.laws_acknowledged()};
}

namespace {

template <class Message>
void force_and_tangent_to(const ContactAnswer& c, Message* out) {
  for (const double force_n : c.force_n) out->add_force_n(force_n);
  for (const double k : c.tangent_n_m) out->add_tangent_n_m(k);
}

void budget_to(const ForceBudget& in, v1::ForceBudget* out) {
  for (const ForceError& error : in.terms()) {
    v1::ForceError* term = out->add_terms();
    term->set_term(message_of(kTerms, error.term));
    term->set_kind(message_of(kKinds, error.kind));
    term->set_relative(error.relative);
  }
  out->set_half_width(in.half_width());
  out->set_above(static_cast<float>(in.above));
}

void taxels_to(const TaxelGrid& grid, const std::vector<double>& pressure_pa, v1::Array* out) {
  const std::vector<float> values(pressure_pa.begin(), pressure_pa.end());
  out->set_dtype(v1::DATA_TYPE_FLOAT32);
  out->add_shape(static_cast<std::uint32_t>(grid.along_z));
  out->add_shape(static_cast<std::uint32_t>(grid.along_x));
  out->set_data(values.data(), values.size() * sizeof(float));
}

void tactile_to(const SentTactile& in, v1::TactileImage* out) {
  const TactileImage& image = in.image;
  out->set_sequence(in.sequence);
  for (const double at_m : image.centre_m) out->add_centre_m(at_m);
  out->set_pitch_m(image.grid.pitch_m);
  taxels_to(image.grid, image.pressure.pressure_pa, out->mutable_pressure_pa());
  if (!image.beyond_pa.empty()) taxels_to(image.grid, image.beyond_pa, out->mutable_beyond_homogeneous_pa());
  out->set_force_n(image.pressure.force_n);
  out->set_outside_n(image.pressure.outside_n);
  for (const double moment : image.pressure.outside_moment_n_m) out->add_outside_moment_n_m(moment);
  out->set_compute_ns(in.took.count());
}

}  // namespace

void answer_to(const TouchStream::Answered& answered, std::uint64_t instance, v1::TouchAnswer* out) {
  const TouchAnswer& in = answered.answer;
  const FingerPose& pose = answered.asked.pose;
  out->set_answer(answered.number);
  out->set_sequence(pose.sequence);
  stamp_to(pose.stamp_ns, pose.stamp_instance, out->mutable_pose_stamp());
  for (std::size_t k = 0; k < pose.components; ++k) out->add_position_m(pose.position_m[k]);
  out->set_compute_ns(answered.computing.count());
  out->set_queued_ns(answered.queued.count());
  out->set_period_s(std::chrono::duration<double>(answered.period).count());
  if (in.taken_in != std::chrono::steady_clock::time_point())
    stamp_to(monotonic_ns(in.taken_in), instance, out->mutable_model_stamp());
  const ContactAnswer& c = in.contact;
  out->set_status(message_of(kStatuses, in.status));
  force_and_tangent_to(c, out);
  if (in.foreseen) {
    for (const double at_m : in.foreseen->position_m) out->mutable_foreseen()->add_position_m(at_m);
    force_and_tangent_to(in.foreseen->contact, out->mutable_foreseen());
  }
  out->set_energy_j(c.energy_j);
  for (const NodalPressure& node : c.pressure) {
    v1::NodalPressure* p = out->add_pressure();
    for (const double at_m : node.position_m) p->add_position_m(at_m);
    p->set_pressure_pa(node.pressure_pa);
    for (const double traction_pa : node.traction_pa) p->add_traction_pa(traction_pa);
  }
  out->set_window_id(in.window_id);
  out->set_model_version(in.model_version);
  out->set_path(message_of(kPaths, in.path));
  if (c.state == ContactState::kContact) {
    v1::SolveReport* solve = out->mutable_solve();
    solve->set_iterations(static_cast<std::uint32_t>(c.solve.iterations));
    solve->set_true_residual(c.solve.true_residual);
    solve->set_recursive_residual(c.solve.recursive_residual);
    solve->set_relative_force_error(c.solve.relative_error);
    solve->set_reason(c.solve.reason);
    solve->set_converged(c.solve.converged);
  }
  out->set_largest_strain(c.largest_strain);
  out->set_warning(in.warning);
  for (const std::string& flag : in.window_flags) out->add_window_flags(flag);
  if (!c.budget.terms().empty()) budget_to(c.budget, out->mutable_budget());
  if (in.log_deviation) out->set_youngs_modulus_log_std(in.log_deviation->all());
  region_to(in.covered, out->mutable_covered());
  if (answered.tactile) tactile_to(*answered.tactile, out->mutable_tactile());
}

void law_to(const LawPiece& piece, v1::LawPiece* out) {
  out->Clear();
  out->set_piece(piece.number);
  out->set_window_id(piece.window_id);
  out->set_model_version(piece.version);
  out->set_begin_x_m(piece.begin_m);
  out->set_end_x_m(piece.end_m);
  const LawColumn& lane = piece.columns.front();
  out->set_z_m(lane.z_m);
  out->set_lane_before_m(lane.lane_before_m);
  out->set_guess(!lane.corrected);
  float share = 0, error_n = 0;
  for (const LawColumn& column : piece.columns) {
    share = std::max(share, column.error_share);
    error_n = std::max(error_n, column.error_n);
  }
  out->set_force_error_share(share);
  out->set_force_error_n(error_n);
  const auto of = [](float part, float whole) { return whole > 0 ? part / whole : 0; };
  for (const LawColumn& column : piece.columns) {
    v1::LawColumn* to = out->add_columns();
    to->set_x_m(column.x_m);
    // One share of both: never less than the column states of either.
    to->set_of_force_error(std::max(of(column.error_share, share), of(column.error_n, error_n)));
    for (std::size_t i = 0; i < column.rows; ++i) {
      to->add_log_indentation(column.log_depth[i]);
      const LawSample& s = column.samples[i];
      for (const float value : {s.log_energy, s.by_x_1_m, s.by_log_depth, s.mixed_1_m})
        to->add_samples(value);
      if (piece.lanes)
        for (const float value : {s.by_z_1_m, s.by_zs_1_m, s.by_xz_1_m2, s.by_xzs_1_m2})
          to->add_samples(value);
    }
  }
}

}  // namespace teletact::service
