#include "service/imaging/tracking/refinement.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "service/imaging/tracking/median.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {
namespace {

constexpr int kLags = 32, kLaterals = 8;  // of the autocorrelations; LAG_VECTORS of refinement.cl
constexpr int kNoiseRadius = 2;           // nodes over which noise and correlation are gathered
constexpr int kBiasRadius = 1;            // BIAS_RADIUS of refinement.cl
constexpr int kMaxFootprint = 6;          // nodes to each side over which information is averaged
constexpr int kMaxNoiseLines = 10;        // that the autocorrelations are taken from
constexpr int kNoiseRun = 256;            // samples that one item adds up; the host, in double, the rest
constexpr double kRough = 3;  // what a step that another follows may leave over, of what the last may

// A step of strain is smoothed over about the smoothing length, chosen from the data between these limits:
// the strain is taken to change by kStrainChange of its own median magnitude over kChangeLengthM, and the
// noise is what was measured.
constexpr double kStrainChange = 0.1, kChangeLengthM = 1e-3;
constexpr double kMinStrain = 1e-4;  // below it the prior does not narrow any more
constexpr double kShortestM = 0.25e-3, kLongestM[] = {1.5e-3, 1.0e-3};  // lateral, axial

// Nodes to each side that share a bias, of a smoothing length in node steps. A bias rises and falls over
// about two smoothing lengths to each side, edge_bias() averages one node and a half of them, and no bias is
// wider than the mean gradient that it is a deviation from.
int place_radius(double length) {
  return std::clamp(static_cast<int>(std::lround(2 * length - (kBiasRadius + 0.5))), 0, kGradientRadius);
}

}  // namespace

struct Refinement::Kernels {
  explicit Kernels(const Queue& q) {
    const auto build = [&](const char* name) { return q.kernel("refinement", name, Precision::kFloat); };
    autocorrelation = build("autocorrelation"), data_term = build("data_term");
    local_noise = build("local_noise"), local_gradient = build("local_gradient");
    assemble = build("assemble"), correct = build("correct"), edge_pull = build("edge_pull");
    uncertainty = build("uncertainty");
    edge_bias = build("edge_bias");
    pulse_sums = q.kernel("pulse", "pulse_sums", Precision::kFloat);
    pulse_noise = q.kernel("pulse", "pulse_noise", Precision::kFloat);
  }
  Kernel autocorrelation, data_term, local_noise, local_gradient, assemble, correct, edge_pull, uncertainty,
      edge_bias, pulse_sums, pulse_noise;
};

Refinement::~Refinement() = default;

Refinement::Refinement(const Queue& queue, const PcgOptions& options, const SampleGrid& grid,
                       double line_pitch_m, double sample_pitch_m)
    : queue_(queue),
      options_(options),
      grid_(grid),
      line_pitch_m_(line_pitch_m),
      sample_pitch_m_(sample_pitch_m),
      dx_m_(grid.line_step * line_pitch_m),
      dy_m_(grid.sample_step * sample_pitch_m),
      kernels_(std::make_shared<Kernels>(queue)),
      gradients_(queue, grid.nx, grid.ny),
      stencil_(queue.array<float>(36 * static_cast<std::size_t>(grid.nodes()))) {
  const auto nodes = static_cast<std::size_t>(grid.nodes());
  chunks_ = (2 * grid.sample_step + 7) / 8;
  std::vector<float> hat;
  for (int k = -4 * chunks_; k < 4 * chunks_; ++k)
    hat.push_back(static_cast<float>(std::max(0.0, 1 - std::abs(k) / static_cast<double>(grid.sample_step))));
  hat_ = queue.array(hat);
  for (Array<float>* a : {&noise_, &pixels_}) *a = queue.array<float>(nodes);
  for (Array<float>* a : {&rhs_, &pull_, &bias_, &correction_, &information_})
    *a = queue.array<float>(2 * nodes);
  terms_ = queue.array<float>(8 * nodes);
  gradient_ = queue.array<float>(4 * nodes);
  pulses_ = queue.array<float>(16 * nodes);
  model_ = queue.array<float>(8);
  weights_.assign(8, 0.0f);
}

Autocorrelations Refinement::measure(const ImagePair& images, bool robust, Array<float>& correlation) {
  const int step = std::max(1, images.lines / kMaxNoiseLines), lines = (images.lines - 1) / step + 1;
  const auto runs = static_cast<std::size_t>((images.samples + kNoiseRun - 1) / kNoiseRun);
  const std::size_t each = 2 * kLags, items = runs * static_cast<std::size_t>(lines) * kLaterals;
  if (products_.size() != items * each) products_ = queue_.array<float>(items * each);
  kernels_->autocorrelation({{static_cast<std::size_t>(lines), kLaterals, runs}, {1, 1, 1}, kNoiseRun},
                            images.mean, images.difference, products_, step, lines, kLaterals, images.samples,
                            kNoiseRun, images.layout);
  const std::vector<float> products = queue_.read(products_);
  const std::vector<double> zeros(kLags * kLaterals, 0.0);
  Autocorrelations a{kLags, kLaterals, zeros, zeros};
  for (std::size_t n = 0; n < items; ++n)
    for (std::size_t k = 0; k < kLags; ++k) {
      const std::size_t to = k + kLags * (n % kLaterals);
      a.mean[to] += products[n * each + k];
      a.difference[to] += products[n * each + kLags + k];
    }
  noise_model_ = noise_model(a);
  gather(images, robust, correlation);
  return a;
}

// The robust weights need the noise of these images: that of a first pass.
void Refinement::gather(const ImagePair& images, bool robust, Array<float>& correlation) {
  const SampleGrid& g = grid_;
  for (std::size_t c = 0; c < 2; ++c) {
    weights_[4 + c] = static_cast<float>(noise_model_.spread[c]);
    weights_[6 + c] = static_cast<float>(noise_model_.sensitivity[c]);
  }
  queue_.send(model_, weights_.data(), weights_.size());
  queue_.fill_zero(noise_);
  for (int pass = 0; pass < (robust ? 2 : 1); ++pass) {
    kernels_->data_term(over(g.nodes()), images.mean, images.difference, hat_, noise_, terms_, pixels_, g,
                        images.layout, images.lines, chunks_);
    kernels_->local_noise(over(g.nodes()), terms_, pixels_, model_, correlation, noise_, information_, g.nx,
                          g.ny, kNoiseRadius);
  }
  if (robust) {  // of the last step: what the steps before it are weighed with need not be as exact
    kernels_->pulse_sums(over(g.nodes()), images.mean, images.difference, noise_, pulses_, g, images.layout,
                         images.lines);
    kernels_->pulse_noise(over(g.nodes()), pulses_, noise_, information_, g.nx, g.ny, kNoiseRadius);
  }
  find_medians();
}

// Over the nodes that hear anything, component by component.
void Refinement::find_medians() {
  const std::vector<float> all = queue_.read(information_);
  for (std::size_t c = 0; c < 2; ++c) {
    std::vector<float> held;
    held.reserve(all.size() / 2);
    for (std::size_t n = c; n < all.size(); n += 2)
      if (all[n] > 0) held.push_back(all[n]);
    median_information_[c] = median(held);
  }
}

// Smoothing lengths l from the median information and strain, and the weights of the edges, w = h l^2 /
// spacing^2 (T2.3).
void Refinement::weigh(const Array<float>& field) {
  const SampleGrid& g = grid_;
  kernels_->local_gradient(over(g.nodes()), field, gradient_, g.nx, g.ny, kGradientRadius, kGradientRadius);
  const std::vector<float> slopes = queue_.read(gradient_);
  std::vector<float> strain;
  for (std::size_t n = 3; n < slopes.size(); n += 4) strain.push_back(std::abs(slopes[n]));
  const double typical = std::max(kMinStrain, median(strain) * sample_pitch_m_ / dy_m_);
  const double change_m = kStrainChange * typical * kChangeLengthM;
  const double pitch[] = {line_pitch_m_, sample_pitch_m_};
  for (std::size_t c = 0; c < 2; ++c) {
    const double information = std::max(median_information_[c], 1e-12);
    const double free = std::sqrt(dx_m_ * dy_m_ / information) * pitch[c] / change_m;
    const double length = std::clamp(free, kShortestM, kLongestM[c]);
    smoothing_m_[c] = length;
    weights_[c] = static_cast<float>(information * length * length / (dx_m_ * dx_m_));
    weights_[2 + c] = static_cast<float>(information * length * length / (dy_m_ * dy_m_));
  }
  queue_.send(model_, weights_.data(), weights_.size());
}

void Refinement::step(const Array<float>& field, Array<float>& out, float lateral_limit, float axial_limit,
                      bool last) {
  weigh(field);
  kernels_->assemble(over(grid_.nodes()), terms_, noise_, information_, field, gradient_, model_, stencil_,
                     rhs_, grid_.nx, grid_.ny);
  PcgOptions options = options_;
  options.relative_residual *= last ? 1 : kRough;
  solved_ = gradients_.solve(stencil_, rhs_, correction_, options);
  kernels_->correct(over(grid_.nodes()), field, correction_, out, grid_.nodes(), lateral_limit, axial_limit);
}

std::shared_ptr<const NoiseStructure> Refinement::uncertainty(const Array<float>& field, int steps,
                                                              Array<float>& information,
                                                              Array<float>& deviation_m) {
  auto noise = std::make_shared<NoiseStructure>();
  noise->unit_m = {line_pitch_m_, sample_pitch_m_};
  std::vector<int> footprint, place;
  for (std::size_t c = 0; c < 2; ++c) {
    const SmootherResponse smoother{weights_[c], weights_[2 + c], kGradientRadius, steps};
    noise->response[c] = NoiseResponse(smoother, median_information_[c], grid_.line_step, grid_.sample_step);
    for (const double step_m : {dx_m_, dy_m_}) {
      footprint.push_back(
          std::min(kMaxFootprint, 1 + static_cast<int>(std::lround(smoothing_m_[c] / step_m))));
      place.push_back(place_radius(smoothing_m_[c] / step_m));
    }
  }
  footprint.insert(footprint.end(), place.begin(), place.end());
  // The gradients still are those that the last step pulled towards: the edges' force is the one that it
  // left.
  kernels_->edge_pull(over(grid_.nodes()), field, gradient_, model_, pull_, grid_.nx, grid_.ny);
  look_up(*noise, footprint, information, deviation_m);
  return noise;
}

void Refinement::look_up(const NoiseStructure& noise, const std::vector<int>& radii,
                         Array<float>& information, Array<float>& deviation_m) {
  std::vector<float> tables;
  const auto add = [&](auto&& table_of) {
    for (const NoiseResponse& response : noise.response) {
      const DeviationTable table = table_of(response);
      tables.insert(tables.end(), table.begin(), table.end());
    }
  };
  add([](const NoiseResponse& r) { return r.table([](double, double) { return 1.0; }); });
  add([](const NoiseResponse& r) { return r.bias_noise(kBiasRadius); });
  add([](const NoiseResponse& r) { return r.bias_over_seen(kBiasRadius); });
  kernels_->edge_bias(over(grid_.nodes()), information_, pull_, bias_, grid_.nx, grid_.ny);
  kernels_->uncertainty(over(grid_.nodes()), information_, bias_, sent(queue_, tables), sent(queue_, radii),
                        information, deviation_m, grid_.nx, grid_.ny,
                        static_cast<float>(noise.response[0].median()),
                        static_cast<float>(noise.response[1].median()), static_cast<float>(line_pitch_m_),
                        static_cast<float>(sample_pitch_m_));
}

}  // namespace teletact::service
