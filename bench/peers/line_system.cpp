#include "bench/peers/line_system.h"

#include <cmath>

namespace teletact::bench {
namespace {

constexpr double kTolerance = 1e-6;
constexpr int kMaxIterations = 200;

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t n = 0; n < a.size(); ++n) sum += a[n] * b[n];
  return sum;
}

}  // namespace

LineSystem::LineSystem(int samples, int lines, const RegularisationWeights& weights)
    : samples_(samples),
      lines_(lines),
      weights_(weights),
      diagonal_(static_cast<std::size_t>(samples) * static_cast<std::size_t>(lines), Block{1e-12, 0, 1e-12}),
      right_(2 * diagonal_.size(), 0.0) {
  for (int l = 0; l < lines; ++l)
    for (int k = 0; k < samples; ++k) {
      Block& d = diagonal_[static_cast<std::size_t>(k + samples * l)];
      const int along = (k > 0) + (k + 1 < samples), across = (l > 0) + (l + 1 < lines);
      d[0] += along * weights.axial_1 + across * weights.axial_2;
      d[2] += along * weights.lateral_1 + across * weights.lateral_2;
    }
}

void LineSystem::add_datum(std::size_t n, double axial_slope, double lateral_slope, double residual) {
  diagonal_[n][0] += axial_slope * axial_slope;
  diagonal_[n][1] += axial_slope * lateral_slope;
  diagonal_[n][2] += lateral_slope * lateral_slope;
  right_[2 * n] += axial_slope * residual;
  right_[2 * n + 1] += lateral_slope * residual;
}

template <class Couple>
void LineSystem::for_neighbours(Couple&& couple) const {
  for (int l = 0; l < lines_; ++l)
    for (int k = 0; k < samples_; ++k) {
      const auto n = static_cast<std::size_t>(k + samples_ * l);
      if (k + 1 < samples_) couple(n, n + 1, weights_.axial_1, weights_.lateral_1);
      if (l + 1 < lines_)
        couple(n, n + static_cast<std::size_t>(samples_), weights_.axial_2, weights_.lateral_2);
    }
}

void LineSystem::add_smoothness_of(const std::vector<double>& axial, const std::vector<double>& lateral) {
  const auto couple = [&](std::size_t a, std::size_t b, double axial_weight, double lateral_weight) {
    const double da = axial_weight * (axial[a] - axial[b]), dl = lateral_weight * (lateral[a] - lateral[b]);
    right_[2 * a] -= da, right_[2 * a + 1] -= dl;
    right_[2 * b] += da, right_[2 * b + 1] += dl;
  };
  for_neighbours(couple);
}

void LineSystem::factor() {
  pivots_.resize(diagonal_.size());
  const double a = weights_.axial_1, b = weights_.lateral_1;
  for (int l = 0; l < lines_; ++l)
    for (int k = 0; k < samples_; ++k) {
      const auto n = static_cast<std::size_t>(k + samples_ * l);
      Block d = diagonal_[n];
      if (k > 0) {
        const Block& p = pivots_[n - 1];
        d[0] -= a * a * p[0], d[1] -= a * b * p[1], d[2] -= b * b * p[2];
      }
      const double determinant = d[0] * d[2] - d[1] * d[1];
      pivots_[n] = {d[2] / determinant, -d[1] / determinant, d[0] / determinant};
    }
}

void LineSystem::solve_line(int line, double* x) const {
  const double a = weights_.axial_1, b = weights_.lateral_1;
  const Block* p = &pivots_[static_cast<std::size_t>(samples_) * static_cast<std::size_t>(line)];
  const auto apply = [](const Block& m, double* v) {
    const double axial = m[0] * v[0] + m[1] * v[1];
    v[1] = m[1] * v[0] + m[2] * v[1];
    v[0] = axial;
  };
  apply(p[0], x);  // x_k = P_k y_k on the way down
  for (int k = 1; k < samples_; ++k) {
    x[2 * k] += a * x[2 * k - 2];
    x[2 * k + 1] += b * x[2 * k - 1];
    apply(p[k], x + 2 * k);
  }
  for (int k = samples_ - 2; k >= 0; --k) {
    double behind[] = {a * x[2 * k + 2], b * x[2 * k + 3]};
    apply(p[k], behind);
    x[2 * k] += behind[0];
    x[2 * k + 1] += behind[1];
  }
}

std::vector<double> LineSystem::times(const std::vector<double>& x) const {
  std::vector<double> y(x.size());
  for (std::size_t n = 0; n < diagonal_.size(); ++n) {
    const Block& d = diagonal_[n];
    y[2 * n] = d[0] * x[2 * n] + d[1] * x[2 * n + 1];
    y[2 * n + 1] = d[1] * x[2 * n] + d[2] * x[2 * n + 1];
  }
  const auto couple = [&](std::size_t m, std::size_t n, double axial, double lateral) {
    y[2 * m] -= axial * x[2 * n], y[2 * m + 1] -= lateral * x[2 * n + 1];
    y[2 * n] -= axial * x[2 * m], y[2 * n + 1] -= lateral * x[2 * m + 1];
  };
  for_neighbours(couple);
  return y;
}

std::vector<double> LineSystem::preconditioned(const std::vector<double>& r) const {
  std::vector<double> z = r;
  const auto line_values = 2 * static_cast<std::size_t>(samples_);
  const auto from = [&](const double* neighbour, double* x) {
    for (std::size_t k = 0; k < line_values; k += 2) {
      x[k] += weights_.axial_2 * neighbour[k];
      x[k + 1] += weights_.lateral_2 * neighbour[k + 1];
    }
  };
  for (int l = 0; l < lines_; ++l) {
    double* x = &z[line_values * static_cast<std::size_t>(l)];
    if (l > 0) from(x - line_values, x);
    solve_line(l, x);
  }
  std::vector<double> correction(line_values);
  for (int l = lines_ - 2; l >= 0; --l) {
    double* x = &z[line_values * static_cast<std::size_t>(l)];
    correction.assign(line_values, 0.0);
    from(x + line_values, correction.data());
    solve_line(l, correction.data());
    for (std::size_t k = 0; k < line_values; ++k) x[k] += correction[k];
  }
  return z;
}

std::vector<double> LineSystem::solve() {
  factor();
  std::vector<double> x(right_.size(), 0.0), r = right_, z = preconditioned(r), p = z;
  double rz = dot(r, z);
  const double goal = kTolerance * kTolerance * dot(r, r);
  for (int iteration = 0; iteration < kMaxIterations && dot(r, r) > goal; ++iteration) {
    const std::vector<double> q = times(p);
    const double alpha = rz / dot(p, q);
    for (std::size_t n = 0; n < x.size(); ++n) x[n] += alpha * p[n], r[n] -= alpha * q[n];
    z = preconditioned(r);
    const double next = dot(r, z);
    for (std::size_t n = 0; n < x.size(); ++n) p[n] = z[n] + next / rz * p[n];
    rz = next;
  }
  return x;
}

}  // namespace teletact::bench
