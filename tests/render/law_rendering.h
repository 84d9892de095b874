// A finger on tissue with a stiff place: its law, its answers, and a renderer that is given both.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>

#include "client/render/law_renderer.h"

namespace teletact::client::test {

inline constexpr double kTickS = 0.001;

// U = k(x) d^2.5 with a stiff place at x = 30 mm; columns every 2 mm.
inline double stiffness_at(double x_m, double peak) {
  const double off = (x_m - 0.03) / 0.006;
  return 600 * (1 + peak * std::exp(-off * off));
}
inline double stiffness_slope(double x_m, double peak) {
  const double off = (x_m - 0.03) / 0.006;
  return -600 * peak * 2 * off / 0.006 * std::exp(-off * off);
}

inline NearLaw law_of(double peak, std::uint64_t version = 1) {
  NearLaw law;
  for (int i = 0; i <= 30; ++i) {
    LawColumn& column = law.columns[law.count++];
    column.x_m = 0.002 * i;
    column.version = version;
    column.error_share = 0.005F, column.error_n = 0.001F;
    const double k = stiffness_at(column.x_m, peak), slope = stiffness_slope(column.x_m, peak);
    for (const double d : {3e-4, 9e-4, 2.7e-3, 8e-3}) {
      column.log_depth[column.rows] = float(std::log(d));
      column.samples[column.rows++] = {float(std::log(k) + 2.5 * std::log(d)), float(slope / k), 2.5F, 0};
    }
  }
  return law;
}

inline ForceSample answer_at(double x_m, double d_m, double peak, std::uint64_t sequence, double time_s,
                             std::uint64_t version = 1) {
  ForceSample sample;
  sample.sequence = sequence, sample.model_version = version;
  sample.pose_time_s = time_s;
  sample.position_m = {x_m, d_m, 0};
  sample.contact = d_m > 0;
  const double k = stiffness_at(x_m, peak);
  if (sample.contact)
    sample.force_n = {-stiffness_slope(x_m, peak) * std::pow(d_m, 2.5), -2.5 * k * std::pow(d_m, 1.5), 0};
  return sample;
}

inline ToolPose at(double x_m, double d_m) {
  return {{x_m, d_m, 0}, Vector3::Zero()};
}

struct Rendering {
  explicit Rendering(const LawRendererOptions& options = {}) : renderer(options) {}
  Rendered tick(double x_m, double d_m, double dissipated_j = std::numeric_limits<double>::infinity()) {
    time_s += kTickS;
    if (std::isinf(dissipated_j)) return renderer.render(at(x_m, d_m), time_s);
    ledger.earn(dissipated_j);
    if (!(d_m > 0)) ledger.reset();
    return renderer.render(at(x_m, d_m), time_s, ledger);
  }
  bool answer(double x_m, double d_m, double peak, std::uint64_t version = 1) {
    return renderer.update(answer_at(x_m, d_m, peak, ++sequence, time_s, version), at(x_m, d_m), time_s);
  }
  LawRenderer renderer;
  EnergyLedger ledger;
  double time_s = 0;
  std::uint64_t sequence = 0;
};

}  // namespace teletact::client::test
