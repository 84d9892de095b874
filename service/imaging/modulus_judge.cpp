#include "service/imaging/modulus_judge.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "service/imaging/modulus_seed.h"
#include "service/imaging/window_nodes.h"

namespace teletact::service {
namespace {

constexpr double kBackgroundLog = 0.4;  // |log(E / background)| of what the ramp is judged by
constexpr double kSmear = 0.4;          // standard deviation of a triangular kernel over its reach

std::string text(const char* format, double a, double b = 0) {
  char line[256];
  std::snprintf(line, sizeof line, format, a, b);
  return line;
}

double median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Slopes of log E between the nearest said nodes on both sides, per node of the image grid.
double jump_over(const Field& e, const ImageGrid& g, std::size_t n, double reach_x_m, double reach_y_m) {
  const std::size_t i = n % g.nx, j = n / g.nx;
  const auto slope = [&](std::size_t low, std::size_t high, double distance) {
    const double s = std::log(e[high] / e[low]) / distance;
    return std::isfinite(s) ? s : 0.0;
  };
  const std::size_t left = i > 0 ? n - 1 : n, right = i + 1 < g.nx ? n + 1 : n;
  const std::size_t above = j > 0 ? n - g.nx : n, below = j + 1 < g.ny ? n + g.nx : n;
  const double x = slope(left, right, static_cast<double>(right - left) * g.dx_m);
  const double y = slope(above, below, static_cast<double>((below - above) / g.nx) * g.dy_m);
  return std::hypot(x * reach_x_m, y * reach_y_m);
}

}  // namespace

ModulusJudge::ModulusJudge(Queue queue, std::shared_ptr<StripCache> strips, JudgeLimits limits,
                           SlopeReach reach)
    : queue_(std::move(queue)), strips_(std::move(strips)), limits_(limits), reach_(reach) {}

void ModulusJudge::judge(const ModulusInput& in, ModulusEstimate& out) const {
  deviation(in, out);
  untracked(in, out);
  ramp(in, out);
  out_of_plane(in, out);
}

// Standard deviation of the axial strain over its size: as it came with the strain, else of plane fits.
Field ModulusJudge::relative_noise(const ModulusInput& in) const {
  if (in.displacement.noise) {
    const std::vector<float> std = queue_.read(in.strain.std), tensor = queue_.read(in.strain.tensor);
    Field noise(in.grid.size());
    for (std::size_t n = 0; n < noise.size(); ++n) noise[n] = std[3 * n + 1] / std::abs(tensor[4 * n + 1]);
    return noise;
  }
  const auto strip = strips_->get(in.tissue, in.window_width_m);
  const WindowNodes nodes(strip->model);
  const AxialSlopes slopes = axial_slopes(nodes, in.grid, queue_.read(in.displacement.field_m),
                                          queue_.read(in.displacement.trusted), reach_, kTrackingWindowM2);
  std::vector<double> relative(nodes.size(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t n = 0; n < nodes.size(); ++n)
    if (slopes.measured[n]) relative[n] = slopes.along_deviation[n] / std::abs(slopes.along[n]);
  return nodes.on_image(relative, in.grid);
}

void ModulusJudge::deviation(const ModulusInput& in, ModulusEstimate& out) const {
  const Field noise = relative_noise(in);
  out.log_deviation.assign(in.grid.size(), std::numeric_limits<float>::quiet_NaN());
  std::vector<float> said;
  for (std::size_t n = 0; n < noise.size(); ++n) {
    if (!std::isfinite(out.youngs_modulus[n])) continue;
    const double smeared = kSmear * jump_over(out.youngs_modulus, in.grid, n, reach_.x_m, reach_.y_m);
    // Where the axial strain is not measured, the modulus is a guess: within a factor of two.
    const double own = std::isfinite(noise[n]) ? noise[n] : std::log(2.0);
    out.log_deviation[n] = static_cast<float>(std::hypot(own, smeared));
    said.push_back(out.log_deviation[n]);
  }
  if (!said.empty() && median(said) > limits_.deviation)
    out.warnings.push_back(
        {ModulusFlag::kNoise, text("the modulus is uncertain by %.0f %% (median): the strain is noisy; press "
                                   "further between the frames",
                                   100 * median(said))});
}

void ModulusJudge::untracked(const ModulusInput& in, ModulusEstimate& out) const {
  const std::vector<std::uint8_t> trusted = queue_.read(in.displacement.trusted);
  double inside = 0, without = 0;
  for (std::size_t n = 0; n < trusted.size(); ++n) {
    if (in.grid.origin_y_m + static_cast<double>(n / in.grid.nx) * in.grid.dy_m > in.tissue.depth_m) continue;
    ++inside;
    if (!trusted[n]) ++without;
  }
  if (without > limits_.untracked * inside)
    out.warnings.push_back(
        {ModulusFlag::kUntracked,
         text("%.0f %% of the image could not be tracked (low correlation): nothing is said "
              "there, and the modulus beside it leans on the model",
              100 * without / inside)});
}

// A plane through log E of what looks like background: the traction under a flat frictionless probe leaves
// none.
void ModulusJudge::ramp(const ModulusInput& in, ModulusEstimate& out) const {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d load = Eigen::Vector3d::Zero();
  const double height = static_cast<double>(in.grid.ny - 1) * in.grid.dy_m;
  for (std::size_t n = 0; n < out.youngs_modulus.size(); ++n) {
    const double logarithm = std::log(out.youngs_modulus[n] / out.background);
    if (!(std::abs(logarithm) < kBackgroundLog)) continue;
    const Eigen::Vector3d f(1, static_cast<double>(n % in.grid.nx) * in.grid.dx_m / in.window_width_m,
                            static_cast<double>(n / in.grid.nx) * in.grid.dy_m / height);
    normal += f * f.transpose();
    load += logarithm * f;
  }
  const Eigen::Vector3d plane = normal.fullPivLu().solve(load);
  const double across = std::exp(std::abs(plane[1])), down = std::exp(std::abs(plane[2]));
  if (std::max(across, down) > limits_.ramp)
    out.warnings.push_back(
        {ModulusFlag::kRamp, text("the background's modulus ramps by a factor of %.2f across and %.2f down "
                                  "the window: the probe may "
                                  "be tilted or touch in part, or the tissue's extent be another than stated",
                                  across, down)});
}

void ModulusJudge::out_of_plane(const ModulusInput& in, ModulusEstimate& out) const {
  const std::vector<float> tensor = queue_.read(in.strain.tensor);
  const std::vector<std::uint8_t> trusted = queue_.read(in.strain.trusted);
  std::vector<float> lateral, axial;
  for (std::size_t n = 0; n < trusted.size(); ++n)
    if (trusted[n]) lateral.push_back(tensor[4 * n]), axial.push_back(tensor[4 * n + 1]);
  if (lateral.empty()) return;
  const double ratio = -median(lateral) / median(axial), nu = in.tissue.poisson_ratio;
  const double expected = in.tissue.plane == Plane::kStrain ? nu / (1 - nu) : nu;
  if (std::abs(ratio - expected) > limits_.lateral_ratio)
    out.warnings.push_back(
        {ModulusFlag::kOutOfPlane,
         text("the tissue spreads sideways by %.2f of its axial strain, not by %.2f as assumed: it moves "
              "across "
              "the image plane, or nu or the plane condition is another; the modulus is off by up to a third",
              ratio, expected)});
}

}  // namespace teletact::service
