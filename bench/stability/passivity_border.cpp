#include "bench/stability/passivity_border.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "bench/stability/renderers.h"

namespace teletact::bench {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Triplets = std::vector<Eigen::Triplet<double>>;

struct Delay {
  std::size_t whole;  // periods
  double part;        // of a period, 0 <= part < 1
};

Delay split(double delay_periods) {
  constexpr double kRounding = 1e-9;
  const double whole = std::floor(delay_periods + kRounding);
  return {static_cast<std::size_t>(whole), std::max(delay_periods - whole, 0.0)};
}

// Instants in T: k (sampled) and, for a fractional delay, k + part (the force changes).
std::vector<double> instants(const Delay& delay, std::size_t periods) {
  std::vector<double> times;
  for (std::size_t k = 0; k <= periods; ++k) {
    times.push_back(static_cast<double>(k));
    if (delay.part > 0 && k < periods) times.push_back(static_cast<double>(k) + delay.part);
  }
  return times;
}

// A and B of the header for unit T and K, over the positions at the instants, both ends at zero.
struct Forms {
  Sparse a, b;
};

Forms make_forms(const Delay& delay, std::size_t periods) {
  const std::vector<double> times = instants(delay, periods);
  const std::size_t per_period = delay.part > 0 ? 2 : 1;
  const std::size_t last = times.size() - 1;
  assert(last > 1);  // else nothing is free to move
  Triplets a, b;
  const auto add = [last](Triplets& form, std::size_t i, std::size_t j, double value) {
    if (i == 0 || j == 0 || i == last || j == last) return;  // held at zero
    form.emplace_back(static_cast<int>(i - 1), static_cast<int>(j - 1), value / 2);
    form.emplace_back(static_cast<int>(j - 1), static_cast<int>(i - 1), value / 2);
  };
  for (std::size_t piece = 0; piece < last; ++piece) {
    const double duration = times[piece + 1] - times[piece];
    // (x' - x)^2 / duration
    add(a, piece, piece, 1 / duration);
    add(a, piece + 1, piece + 1, 1 / duration);
    add(a, piece, piece + 1, -2 / duration);
    // f (x' - x), f = the sample whose force acts here
    const std::size_t period = piece / per_period;
    const bool before_change = per_period == 2 && piece % 2 == 0;
    const std::size_t late = delay.whole + (before_change ? 1 : 0);
    if (period < late) continue;
    const std::size_t sample = (period - late) * per_period;
    add(b, sample, piece + 1, 1);
    add(b, sample, piece, -1);
  }
  const auto size = static_cast<Eigen::Index>(last - 1);
  Forms forms;
  forms.a.resize(size, size);
  forms.b.resize(size, size);
  forms.a.setFromTriplets(a.begin(), a.end());
  forms.b.setFromTriplets(b.begin(), b.end());
  return forms;
}

bool positive(const Eigen::SimplicialLDLT<Sparse>& factor) {
  return factor.info() == Eigen::Success && factor.vectorD().minCoeff() > 0;
}

}  // namespace

ImposedMotion worst_motion(double delay_periods, std::size_t periods) {
  if (!(delay_periods >= 0) || periods < 4)
    throw std::invalid_argument("worst_motion: a delay >= 0 and at least 4 periods");
  const Delay delay = split(delay_periods);
  const Forms forms = make_forms(delay, periods);
  // Bisection on "b A + B is positive": the border is between.
  double low = 0, high = 4 * (1 + delay_periods);
  Eigen::SimplicialLDLT<Sparse> factor;
  factor.analyzePattern(forms.a + forms.b);
  constexpr double kRelative = 1e-6;
  while (high - low > kRelative * high) {
    const double middle = (low + high) / 2;
    factor.factorize(middle * forms.a + forms.b);
    (positive(factor) ? high : low) = middle;
  }
  // The motion: the eigenvector, by inverse iteration from just above the border.
  factor.factorize(high * forms.a + forms.b);
  Eigen::VectorXd x(forms.a.rows());
  for (Eigen::Index i = 0; i < x.size(); ++i)
    x(i) = std::sin(1.0 + 1.7 * static_cast<double>(i));  // anything
  for (int step = 0; step < 8; ++step) x = factor.solve(forms.a * x).normalized();
  ImposedMotion motion{instants(delay, periods), {0}};
  motion.position.insert(motion.position.end(), x.begin(), x.end());
  motion.position.push_back(0);
  return motion;
}

double border_n_s_m(const ImposedMotion& motion, double stiffness_n_m, double period_s, double delay_s) {
  HoldRenderer hold;
  const double delay_periods = delay_s / period_s;
  constexpr double kRounding = 1e-9;  // of a period
  // Pressed this deep at position 0, so that the hold renderer stays in contact; a constant force does no
  // work on a motion that ends where it began.
  const double scale_m = 1e-3, depth_m = 10 * scale_m;
  double largest = 0;
  for (const double position : motion.position) largest = std::max(largest, std::abs(position));
  std::vector<client::ForceSample> samples;
  std::size_t arrived = 0;
  double dissipated = 0, work_j = 0;  // per N s/m; put in against the force
  for (std::size_t i = 0; i + 1 < motion.position.size(); ++i) {
    const double time = motion.time_periods[i];
    const double y_m = depth_m + scale_m * motion.position[i] / largest;
    const client::ToolPose tool{client::Vector3(0, y_m, 0), client::Vector3::Zero()};
    if (std::abs(time - std::round(time)) < kRounding) {
      client::ForceSample sample;
      sample.contact = true;
      sample.pose_time_s = std::round(time) * period_s;
      sample.position_m = tool.position_m;
      sample.force_n = client::Vector3(0, -stiffness_n_m * y_m, 0);
      samples.push_back(sample);
    }
    while (arrived < samples.size() && static_cast<double>(arrived) + delay_periods <= time + kRounding)
      hold.update(samples[arrived++], tool, time * period_s);
    // Until the first answer the spring is felt as it was before the motion: at rest.
    const double force_n =
        arrived == 0 ? stiffness_n_m * depth_m : -hold.render(tool, time * period_s).force_n.y();
    const double step_m = scale_m * (motion.position[i + 1] - motion.position[i]) / largest;
    work_j += force_n * step_m;
    dissipated += step_m * step_m / ((motion.time_periods[i + 1] - time) * period_s);
  }
  return std::max(-work_j / dissipated, 0.0);
}

double colgate_border_n_s_m(double stiffness_n_m, double period_s, double delay_s) {
  const double d = delay_s / period_s;
  const double e = split(d).part;
  return stiffness_n_m * period_s / 2 * (0.5 + d + std::sqrt((0.5 + d) * (0.5 + d) + e * (1 - e)));
}

}  // namespace teletact::bench
