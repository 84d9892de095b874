// Gauss-Newton with a finite-difference Jacobian: Kallel & Bertrand 1996, "Tissue elasticity reconstruction
// using linear perturbation method", IEEE Trans. Med. Imaging 15(3):299-313, doi 10.1109/42.500139. One
// forward solve per patch and iteration; their Tikhonov term is on log E here, with another on the difference
// between neighbouring patches; the probe's unknown push is one more unknown; steps are damped after
// Levenberg and Marquardt, so that no badly determined patch holds the others up.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/peers/modulus_peer.h"
#include "bench/peers/patch_forward.h"

namespace teletact::bench {
namespace {

constexpr int kIterations = 8, kAttempts = 4;
constexpr double kFirstDamping = 1e-3, kMinGain = 1e-2;  // of the cost
constexpr double kPerturbation = 1e-3;                     // of log E
constexpr double kNoiseM = 0.4e-6;                         // of a datum: what balances the two terms
constexpr double kSmoothness = 20;  // of a unit step of log E between neighbours, in squared deviations
constexpr double kTikhonov = 1;     // of a unit of log E of one patch
constexpr double kMinValid = 4;   // image nodes that make a datum

// The measured displacement at the forward model's points, by a plane fitted around each (a mean would be off
// where more nodes lie on one side); NaN where little is valid.
Eigen::VectorXd data_of(const Track& t, const std::vector<PatchForward::Point>& points) {
  constexpr double kReachM = 0.75e-3;
  Eigen::VectorXd data(static_cast<Eigen::Index>(points.size()));
  for (std::size_t k = 0; k < points.size(); ++k) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    const auto range = [&](double centre, double origin, double step, std::size_t size) {
      const auto low = static_cast<std::ptrdiff_t>(std::ceil((centre - kReachM - origin) / step));
      const auto high = static_cast<std::ptrdiff_t>(std::floor((centre + kReachM - origin) / step));
      return std::pair(std::max<std::ptrdiff_t>(0, low),
                       std::min(static_cast<std::ptrdiff_t>(size) - 1, high));
    };
    const auto [i0, i1] = range(points[k].x_m, t.grid.origin_x_m, t.grid.dx_m, t.grid.nx);
    const auto [j0, j1] = range(points[k].y_m, t.grid.origin_y_m, t.grid.dy_m, t.grid.ny);
    for (auto j = j0; j <= j1; ++j)
      for (auto i = i0; i <= i1; ++i) {
        const auto n = static_cast<std::size_t>(i) + t.grid.nx * static_cast<std::size_t>(j);
        if (!t.valid[n]) continue;
        const Eigen::Vector3d base(
            1, (t.grid.origin_x_m + static_cast<double>(i) * t.grid.dx_m - points[k].x_m) / kReachM,
            (t.grid.origin_y_m + static_cast<double>(j) * t.grid.dy_m - points[k].y_m) / kReachM);
        normal += base * base.transpose(), right += t.axial_m[n] * base;
      }
    const Eigen::LLT<Eigen::Matrix3d> fit(normal);
    data[static_cast<Eigen::Index>(k)] = normal(0, 0) >= kMinValid && fit.info() == Eigen::Success
                                             ? fit.solve(right)[0]
                                             : std::numeric_limits<double>::quiet_NaN();
  }
  return data;
}

// A modulus, what it answers, and what is minimised: squared deviations of the data and of the prior.
struct State {
  Eigen::VectorXd log_e;
  PatchForward::Response response;
  double push_m = 0, cost = 0;
};

struct Normal {
  Eigen::MatrixXd matrix;  // of log E, then of the push
  Eigen::VectorXd right;
  // Of log E, Levenberg-Marquardt; the push moves along and is found again afterwards.
  Eigen::VectorXd step(double damping) const {
    Eigen::MatrixXd damped = matrix;
    damped.diagonal() *= 1 + damping;
    return damped.ldlt().solve(right).head(right.size() - 1);
  }
};

double best_push(const Eigen::VectorXd& response, const Eigen::VectorXd& data) {
  double cross = 0, square = 0;
  for (Eigen::Index k = 0; k < data.size(); ++k)
    if (std::isfinite(data[k])) cross += response[k] * data[k], square += response[k] * response[k];
  return cross / square;
}

State at(PatchForward& forward, Eigen::VectorXd log_e, const Eigen::VectorXd& data) {
  State s{std::move(log_e), {}, 0, 0};
  s.response = forward.respond(s.log_e.array().exp());
  s.push_m = best_push(s.response.axial, data);
  for (Eigen::Index k = 0; k < data.size(); ++k)
    if (std::isfinite(data[k])) s.cost += std::pow((data[k] - s.push_m * s.response.axial[k]) / kNoiseM, 2);
  for (const auto& [a, b] : forward.neighbours())
    s.cost += kSmoothness *
              std::pow(s.log_e[static_cast<Eigen::Index>(a)] - s.log_e[static_cast<Eigen::Index>(b)], 2);
  s.cost += kTikhonov * s.log_e.squaredNorm();
  return s;
}

Normal linearised(PatchForward& forward, const State& now, const Eigen::VectorXd& data) {
  const Eigen::VectorXd& log_e = now.log_e;
  const Eigen::Index count = log_e.size();
  Eigen::MatrixXd jacobian(data.size(), count + 1);
  for (Eigen::Index k = 0; k < count; ++k) {
    Eigen::VectorXd more = log_e;
    more[k] += kPerturbation;
    jacobian.col(k) = now.push_m / kPerturbation / kNoiseM *
                      (forward.respond(more.array().exp()).axial - now.response.axial);
  }
  jacobian.col(count) = now.response.axial / kNoiseM * now.push_m;  // of log push
  Eigen::VectorXd residual = (data - now.push_m * now.response.axial) / kNoiseM;
  for (Eigen::Index k = 0; k < data.size(); ++k)
    if (!std::isfinite(data[k])) residual[k] = 0, jacobian.row(k).setZero();
  Normal normal{jacobian.transpose() * jacobian, jacobian.transpose() * residual};
  for (const auto& [a, b] : forward.neighbours()) {
    const auto m = static_cast<Eigen::Index>(a), n = static_cast<Eigen::Index>(b);
    normal.matrix(m, m) += kSmoothness, normal.matrix(n, n) += kSmoothness;
    normal.matrix(m, n) -= kSmoothness, normal.matrix(n, m) -= kSmoothness;
    normal.right[m] -= kSmoothness * (log_e[m] - log_e[n]);
    normal.right[n] += kSmoothness * (log_e[m] - log_e[n]);
  }
  normal.matrix.diagonal().head(count).array() += kTikhonov;
  normal.right.head(count) -= kTikhonov * log_e;
  return normal;
}

// Bilinear in log E between the patches' centres.
std::vector<float> on_nodes(const PatchForward& forward, const service::ImageGrid& g,
                            const Eigen::VectorXd& log_e, double scale) {
  std::vector<float> out(g.size());
  const int nx = forward.patches_x(), ny = forward.patches_y();
  for (std::size_t n = 0; n < out.size(); ++n) {
    const double x = (g.origin_x_m + static_cast<double>(n % g.nx) * g.dx_m) / forward.patch_m() - .5;
    const double y = (g.origin_y_m + static_cast<double>(n / g.nx) * g.dy_m) / forward.patch_m() - .5;
    const int i = std::clamp(static_cast<int>(std::floor(x)), 0, nx - 2),
              j = std::clamp(static_cast<int>(std::floor(y)), 0, ny - 2);
    const double s = std::clamp(x - i, 0.0, 1.0), t = std::clamp(y - j, 0.0, 1.0);
    const auto at = [&](int c, int r) { return log_e[c + nx * r]; };
    out[n] = static_cast<float>(scale * std::exp((1 - t) * ((1 - s) * at(i, j) + s * at(i + 1, j)) +
                                                 t * ((1 - s) * at(i, j + 1) + s * at(i + 1, j + 1))));
  }
  return out;
}

std::vector<float> by_gauss_newton(const ModulusProblem& p) {
  PatchForward forward(p.tissue, p.window_width_m, p.window_depth_m);
  const Eigen::VectorXd data = data_of(p.track, forward.points());
  const auto count = static_cast<Eigen::Index>(forward.patches());
  State now = at(forward, Eigen::VectorXd::Zero(count), data);
  double damping = kFirstDamping;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Normal normal = linearised(forward, now, data);
    const double before = now.cost;
    for (int attempt = 0; attempt < kAttempts; ++attempt) {
      State next = at(forward, now.log_e + normal.step(damping), data);
      const bool better = next.cost < now.cost;  // false for NaN
      damping *= better ? 0.1 : 10;
      if (!better) continue;
      now = std::move(next);
      break;
    }
    if (!(now.cost < (1 - kMinGain) * before)) break;
  }
  const double force_n_per_m = p.force.force_n / p.force.contact_area_m2 * p.window_width_m;
  return on_nodes(forward, p.track.grid, now.log_e,
                  force_n_per_m / (now.response.force_n_per_m * now.push_m));
}

}  // namespace

ModulusPeer make_gauss_newton() {
  return {"Gauss-Newton, finite-difference Jacobian", by_gauss_newton};
}

}  // namespace teletact::bench
