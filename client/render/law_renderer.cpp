#include "client/render/law_renderer.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace teletact::client {
namespace {

constexpr double kSharpness = 8;  // of the soft minimum
// Of the display's limits: a soft minimum's force exceeds its lesser potential's by some percent, and a
// lateral part comes to the push.
constexpr double kBelow = 0.94;

// What a law's force is against, along the scene's axes.
Vector3 resistance_of(const LawValue& value) {
  return {value.by_x_n, value.by_d_n, value.by_z_n};
}

}  // namespace

void LawRenderer::reset() noexcept {
  *this = LawRenderer(options_);
}

LawValue LawRenderer::law_at(const Vector3& position_m) const noexcept {
  return evaluate(law_.used(), position_m.x(), position_m.y() - law_.layer_depth_m, position_m.z());
}

bool LawRenderer::wrong(std::uint64_t version) const noexcept {
  return version != 0 && std::find(wrong_.begin(), wrong_.end(), version) != wrong_.end();
}

// Where the finger was at the last tick, along the surface.
Vector2 LawRenderer::along_m() const noexcept {
  return lateral(ContactFrame(surface_.normal).to_contact(position_m_));
}

// What is known worse than to this is left to answers; what is felt, to twice that. A law that draws the
// finger in is none.
bool LawRenderer::trusted(const LawValue& value) const noexcept {
  constexpr double kShare = 0.1, kFloorN = 0.005;
  const double max_n = kShare * resistance_of(value).norm() + kFloorN;
  const bool known = value.error_n - value.disagreement_n <= (by_law_ ? 2 : 1) * max_n;
  const bool resists = !(value.energy_j > 0) || value.by_d_n > 0;
  return value.covered && !value.beyond && known && resists && !stale_ && !wrong(value.oldest) &&
         !wrong(value.newest) && surface_.normal == TouchedSurface{}.normal &&
         surface_.offset_m == law_.layer_depth_m;
}

// Where the newest answer was computed: of a newer version than what is known there, or of no window any
// more.
void LawRenderer::judge_age() noexcept {
  const LawValue value = law_at(answered_m_);
  if (value.covered) stale_ = answered_version_ == 0 || value.newest < answered_version_;
}

// The soft minimum of U and the spring: Phi = (U^-p + S^-p)^(-1/p), so dPhi = (Phi / U)^(p + 1) dU + the same
// of S.
Potential LawRenderer::softened(const LawValue& value, double d) const noexcept {
  if (!(d > 0) || !(value.energy_j > 0)) return {};
  const double stiffness = kBelow * options_.largest_stiffness_n_m, spring_j = stiffness * d * d / 2;
  const double min_j = std::min(value.energy_j, spring_j);
  const double sum = std::pow(min_j / value.energy_j, kSharpness) + std::pow(min_j / spring_j, kSharpness);
  const double phi_j = min_j * std::pow(sum, -1 / kSharpness);
  const double of_law = std::pow(phi_j / value.energy_j, kSharpness + 1);
  const double of_spring = std::pow(phi_j / spring_j, kSharpness + 1);
  return {of_law * resistance_of(value) + Vector3(0, of_spring * stiffness * d, 0), phi_j};
}

// Deeper than where the largest force is reached the energy goes on straight: as with a slider that slips
// there.
Potential LawRenderer::potential(const LawValue& value, const Vector3& position_m, double d) const noexcept {
  const double max_n = kBelow * options_.largest_force_n;
  Potential free = softened(value, d);
  if (free.resistance_n.y() <= max_n) return free;
  constexpr int kHalvings = 30;
  const auto at = [&](double depth_m) {
    return softened(evaluate(law_.used(), position_m.x(), depth_m, position_m.z()), depth_m);
  };
  double below_m = 0, above_m = d;
  for (int k = 0; k < kHalvings; ++k) {
    const double middle_m = (below_m + above_m) / 2;
    const bool slips = at(middle_m).resistance_n.y() > max_n;
    (slips ? above_m : below_m) = middle_m;
  }
  const Potential slips = at(below_m);
  return {{slips.resistance_n.x(), max_n, slips.resistance_n.z()}, slips.energy_j + max_n * (d - below_m)};
}

// Where both columns are of the answer's version: across a border of versions neither is right or wrong
// alone. An answer without force contradicts a law that says some. A guess says itself that it is one; an
// answer may be off, too: of a solid it is corrected beside.
void LawRenderer::check(const ForceSample& sample) noexcept {
  const LawValue value = law_at(sample.position_m);
  if (value.oldest != sample.model_version || value.newest != sample.model_version) return;
  if (!trusted(value) || !value.corrected || !(value.energy_j > 0)) return;
  if (contradicted_ != sample.model_version) contradictions_ = 0;
  contradicted_ = sample.model_version;
  const double may_n = value.error_n + sample.relative_error * sample.force_n.norm();
  const double off = (resistance_of(value) + sample.force_n).norm() / may_n;
  const bool elsewhere =
      contradictions_ == 0 || (sample.position_m - contradicted_m_).norm() > options_.place_m;
  if (!(off > 1)) contradictions_ = 0;
  if (off > (elsewhere ? 1 : options_.contradicts_again)) {
    ++contradictions_;
    contradicted_m_ = sample.position_m;
  }
  if (contradictions_ < options_.contradictions_in_a_row) return;
  std::shift_right(wrong_.begin(), wrong_.end(), 1);
  wrong_.front() = sample.model_version;
  contradictions_ = 0;
  ++dropped_;
}

bool LawRenderer::update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept {
  surface_ = sample.surface;
  answered_m_ = sample.position_m;
  const std::uint64_t before = std::exchange(answered_version_, sample.model_version);  // 0: of no window
  judge_age();
  check(sample);
  const double d = surface_.depth_m(position_m_);
  const std::uint32_t solved_before = sample.solved_by ? std::exchange(solved_by_, sample.solved_by) : 0;
  const bool another = before != 0 && answered_version_ != 0 &&
                       (answered_version_ != before || (solved_before && solved_by_ != solved_before));
  if (!another || by_law_ || !(d > 0)) return kalman_.update(sample, pose, time_s);
  kalman_.distrust();
  const bool believed = kalman_.update(sample, pose, time_s);
  kalman_.take_all();
  blend_.change(EnergyClaim::kModel, felt_, along_m(), d);
  return believed;
}

void LawRenderer::take_law(const NearLaw& law) noexcept {
  law_ = law;
  if (law.count == 0) {  // another stream, perhaps another service
    wrong_ = {};
    stale_ = false;
    answered_m_.setConstant(std::numeric_limits<double>::quiet_NaN());
  } else {
    judge_age();
  }
  const double d = surface_.depth_m(position_m_);
  const LawValue value = law_at(position_m_);
  if (!by_law_ || !(d > 0) || !trusted(value)) return;
  const Potential now = potential(value, position_m_, d);
  if (now.resistance_n != model_.resistance_n || now.energy_j != model_.energy_j)
    blend_.change(EnergyClaim::kLaw, felt_, along_m(), d);
}

Rendered LawRenderer::render(const ToolPose& pose, double time_s, EnergyLedger& ledger) noexcept {
  const double elapsed_s = time_s - std::exchange(rendered_s_, time_s);
  // A filter that is not felt follows its answers for nothing.
  if (by_law_) kalman_.take_all();
  Rendered rendered = kalman_.render(pose, time_s, ledger, blend_.share());
  const double d = surface_.depth_m(pose.position_m);
  const LawValue value = law_at(pose.position_m);
  const bool by_law = trusted(value);
  const double before_m = surface_.depth_m(position_m_);  // in the air nothing was felt that is to go on
  if (d > 0 && before_m > 0 && by_law != by_law_)
    blend_.change(EnergyClaim::kBorder, felt_, along_m(), before_m);
  position_m_ = pose.position_m;
  by_law_ = rendered.by_law = by_law;
  if (!(d > 0)) {
    blend_.clear();
    model_ = felt_ = {};
    return rendered;
  }
  const ContactFrame frame(surface_.normal);
  model_ = by_law ? potential(value, pose.position_m, d)
                  : Potential{frame.to_contact(-rendered.force_n), rendered.stored_j};
  felt_ = blend_.settle(model_, along_m(), d, elapsed_s, ledger);
  if (!by_law && blend_.settled()) return rendered;
  if (by_law) {
    const Vector3 softened_n = resistance_of(value) - model_.resistance_n;
    const double off_n_m = (value.error_n + softened_n.norm()) / d;
    rendered.variance = off_n_m * off_n_m;
    rendered.lateral_variance.setConstant(rendered.variance);
    rendered.withheld = 0;
  }
  const Vector3 felt_n_m = felt_.resistance_n / d;
  const Vector3 missing = (felt_n_m - model_.resistance_n / d).cwiseAbs2();
  rendered.variance += missing.y();
  rendered.lateral_variance += lateral(missing);
  rendered.force_n = frame.to_scene(-felt_.resistance_n);
  rendered.stiffness_n_m = felt_n_m.y();
  rendered.lateral_stiffness_n_m = lateral(felt_n_m);
  rendered.stored_j = felt_.energy_j;
  rendered.withheld = std::max(rendered.withheld, blend_.withheld());
  return rendered;
}

}  // namespace teletact::client
