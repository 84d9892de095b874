// Gauss-Newton with a finite-difference Jacobian: Kallel & Bertrand 1996, "Tissue elasticity reconstruction
// using linear perturbation method", IEEE Trans. Med. Imaging 15(3):299-313, doi 10.1109/42.500139. One
// forward solve per patch and iteration; their Tikhonov term is on log E here, with another on the difference
// between neighbouring patches, and the probe's unknown push is one more unknown.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/peers/modulus_peer.h"
#include "bench/peers/patch_forward.h"

namespace teletact::bench {
namespace {

constexpr int kIterations = 6;
constexpr double kPerturbation = 1e-3;  // of log E
constexpr double kNoiseM = 0.4e-6;      // of a datum: what balances the two terms
constexpr double kSmoothness = 20;      // of a unit step of log E between neighbours, in squared deviations
constexpr double kTikhonov = 50;        // of a unit of log E of one patch
constexpr double kLargestStep = 0.7;    // of log E in one iteration
constexpr double kLeastValid = 4;       // image nodes that make a datum

// Means of the measured displacement around the forward model's points; NaN where nothing is valid.
Eigen::VectorXd data_of(const Track& t, const std::vector<PatchForward::Point>& points) {
  constexpr double kReachM = 0.75e-3;
  Eigen::VectorXd data(static_cast<Eigen::Index>(points.size()));
  for (std::size_t k = 0; k < points.size(); ++k) {
    double sum = 0, count = 0;
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
        if (t.valid[n]) sum += t.axial_m[n], count += 1;
      }
    data[static_cast<Eigen::Index>(k)] =
        count >= kLeastValid ? sum / count : std::numeric_limits<double>::quiet_NaN();
  }
  return data;
}

class GaussNewton : public ModulusPeer {
 public:
  std::string name() const override { return "Gauss-Newton, finite-difference Jacobian"; }

  std::vector<float> estimate(const ModulusProblem& p) override {
    PatchForward forward(p.tissue, p.window_width_m, p.window_depth_m);
    const Eigen::VectorXd data = data_of(p.track, forward.points());
    const auto count = static_cast<Eigen::Index>(forward.patches());
    Eigen::VectorXd log_e = Eigen::VectorXd::Zero(count);
    double push_m = 0;
    PatchForward::Response now = forward.respond(log_e.array().exp());
    push_m = best_push(now.axial, data);
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      log_e += step(forward, log_e, now, data, push_m);
      now = forward.respond(log_e.array().exp());
      push_m = best_push(now.axial, data);
    }
    const double force_n_per_m = p.force.force_n / p.force.contact_area_m2 * p.window_width_m;
    return on_nodes(forward, p.track.grid, log_e, force_n_per_m / (now.force_n_per_m * push_m));
  }

 private:
  static double best_push(const Eigen::VectorXd& response, const Eigen::VectorXd& data) {
    double cross = 0, square = 0;
    for (Eigen::Index k = 0; k < data.size(); ++k)
      if (std::isfinite(data[k])) cross += response[k] * data[k], square += response[k] * response[k];
    return cross / square;
  }

  // Of log E; the push moves along and is found again afterwards.
  static Eigen::VectorXd step(PatchForward& forward, const Eigen::VectorXd& log_e,
                              const PatchForward::Response& now, const Eigen::VectorXd& data, double push_m) {
    const Eigen::Index count = log_e.size();
    Eigen::MatrixXd jacobian(data.size(), count + 1);
    for (Eigen::Index k = 0; k < count; ++k) {
      Eigen::VectorXd more = log_e;
      more[k] += kPerturbation;
      jacobian.col(k) =
          push_m / kPerturbation / kNoiseM * (forward.respond(more.array().exp()).axial - now.axial);
    }
    jacobian.col(count) = now.axial;  // of the push, in units of the noise
    Eigen::VectorXd residual = (data - push_m * now.axial) / kNoiseM;
    for (Eigen::Index k = 0; k < data.size(); ++k)
      if (!std::isfinite(data[k])) residual[k] = 0, jacobian.row(k).setZero();
    Eigen::MatrixXd normal = jacobian.transpose() * jacobian;
    Eigen::VectorXd right = jacobian.transpose() * residual;
    for (const auto& [a, b] : forward.neighbours()) {
      const auto m = static_cast<Eigen::Index>(a), n = static_cast<Eigen::Index>(b);
      normal(m, m) += kSmoothness, normal(n, n) += kSmoothness;
      normal(m, n) -= kSmoothness, normal(n, m) -= kSmoothness;
      right[m] -= kSmoothness * (log_e[m] - log_e[n]), right[n] += kSmoothness * (log_e[m] - log_e[n]);
    }
    normal.diagonal().head(count).array() += kTikhonov;
    right.head(count) -= kTikhonov * log_e;
    // Displacement does not determine a common factor, and finite differences would make one up: it stays.
    normal.topLeftCorner(count, count).array() += normal.diagonal().head(count).mean();
    const Eigen::VectorXd found = normal.ldlt().solve(right).head(count);
    return found * std::min(1.0, kLargestStep / found.cwiseAbs().maxCoeff());
  }

  // Bilinear in log E between the patches' centres.
  static std::vector<float> on_nodes(const PatchForward& forward, const service::ImageGrid& g,
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
};

}  // namespace

std::unique_ptr<ModulusPeer> make_gauss_newton() {
  return std::make_unique<GaussNewton>();
}

}  // namespace teletact::bench
