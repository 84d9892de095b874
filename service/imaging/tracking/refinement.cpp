#include "service/imaging/tracking/refinement.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <string>
#include <utility>

#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {
namespace {

constexpr int kLags = 32, kLaterals = 8;  // of the autocorrelations; LAG_VECTORS of refinement.cl
constexpr int kNoiseRadius = 2;           // nodes over which noise and correlation are gathered
constexpr int kBiasRadius = 1;            // BIAS_RADIUS of refinement.cl
constexpr int kTrustedRows = 8;           // TRUSTED_ROWS of refinement.cl
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

// Numbers of the model, two each, as in the kernels; the weights come first.
constexpr std::size_t kNoise = 4, kMedian = 8, kLength = 10;

constexpr std::size_t kGroupOfGpu = 1024;

// An argument of kernels: Smoothing of smoothing.cl.
struct Smoothing {
  float dx_m, dy_m, line_pitch_m, sample_pitch_m, least_strain, change_m, shortest_m, longest_lateral_m,
      longest_axial_m;
};
static_assert(sizeof(Smoothing) == 9 * sizeof(float));

// Nodes to each side that share a bias, of a smoothing length in node steps. A bias rises and falls over
// about two smoothing lengths to each side, edge_bias() averages one node and a half of them, and no bias is
// wider than the mean gradient that it is a deviation from.
int place_radius(double length) {
  return std::clamp(static_cast<int>(std::lround(2 * length - (kBiasRadius + 0.5))), 0, kGradientRadius);
}

}  // namespace

struct Refinement::Kernels {
  Kernels(const Queue& q, std::size_t group, std::size_t width) {
    const auto build = [&](const char* name) { return q.kernel("refinement", name, Precision::kFloat); };
    autocorrelation = build("autocorrelation"), data_term = build("data_term");
    local_noise = build("local_noise"), local_gradient = build("local_gradient");
    assemble = build("assemble"), correct = build("correct"), edge_pull = build("edge_pull");
    uncertainty = build("uncertainty");
    edge_bias = build("edge_bias");
    pulse_sums = q.kernel("pulse", "pulse_sums", Precision::kFloat);
    pulse_noise = q.kernel("pulse", "pulse_noise", Precision::kFloat);
    weigh_edges = q.kernel("smoothing", "weigh_edges", Precision::kFloat,
                           {{"GROUP", std::to_string(group)}, {"WIDTH", std::to_string(width)}});
  }
  Kernel autocorrelation, data_term, local_noise, local_gradient, assemble, correct, edge_pull, uncertainty,
      edge_bias, pulse_sums, pulse_noise, weigh_edges;
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
      gradients_(queue, grid.nx, grid.ny),
      group_(queue.info().gpu ? std::min(kGroupOfGpu, std::bit_floor(queue.info().max_group)) : 1),
      width_(std::clamp<std::size_t>(queue.info().width<float>(), 2, 16)),
      kernels_(std::make_shared<Kernels>(queue, group_, width_)) {
  const auto nodes = static_cast<std::size_t>(grid.nodes());
  chunks_ = (2 * grid.sample_step + 7) / 8;
  std::vector<float> hat;
  for (int k = -4 * chunks_; k < 4 * chunks_; ++k)
    hat.push_back(static_cast<float>(std::max(0.0, 1 - std::abs(k) / static_cast<double>(grid.sample_step))));
  hat_ = queue.array(hat);
  for (Array<float>* a : {&noise_, &pixels_}) *a = queue.array<float>(nodes);
  for (Array<float>* a : {&pull_, &bias_}) *a = queue.array<float>(2 * nodes);
  for (Array<float>* a : {&diagonal_, &cross_, &rhs_, &correction_}) *a = gradients_.array();
  const auto zeros = [&](std::size_t least) {  // whole vectors
    Array<float> a = queue.array<float>((least + width_ - 1) / width_ * width_);
    queue.fill_zero(a);
    return a;
  };
  information_ = zeros(2 * nodes), strain_ = zeros(nodes);
  terms_ = queue.array<float>(8 * nodes);
  gradient_ = queue.array<float>(4 * nodes);
  pulses_ = queue.array<float>(16 * nodes);
  model_ = zeros(kModel + kRefinementSteps * NodeGradients::kEnd);
}

Autocorrelations Refinement::measure(const ImagePair& images, bool robust, Array<float>& correlation) {
  const int step = std::max(1, images.lines / kMaxNoiseLines), lines = (images.lines - 1) / step + 1;
  const auto runs = static_cast<std::size_t>((images.samples + kNoiseRun - 1) / kNoiseRun);
  const std::size_t each = 2 * kLags, items = runs * static_cast<std::size_t>(lines) * kLaterals;
  if (products_.size() != items * each) products_ = queue_.array<float>(items * each);
  kernels_->autocorrelation({{static_cast<std::size_t>(lines), kLaterals, runs}, {1, 1, 1}, kNoiseRun},
                            images.mean, images.difference, products_, step, lines, kLaterals, images.samples,
                            kNoiseRun, images.layout);
  product_sums_.resize(products_.size());
  Arrival products = queue_.fetch(products_, product_sums_.data(), product_sums_.size());
  queue_.fill_zero(noise_);
  add_terms(images);  // meanwhile
  products.wait();
  Autocorrelations a = added_up();
  const NoiseModel noise = noise_model(a);
  std::vector<float> numbers;
  for (const std::array<double, 2>& of : {noise.spread, noise.sensitivity})
    for (const double number : of) numbers.push_back(static_cast<float>(number));
  queue_.send(model_, std::move(numbers), kNoise);
  gather(images, robust, correlation);
  return a;
}

// Of the runs and lines, in double.
Autocorrelations Refinement::added_up() const {
  constexpr std::size_t kEach = 2 * kLags;
  const std::vector<double> zeros(kLags * kLaterals, 0.0);
  Autocorrelations a{kLags, kLaterals, zeros, zeros};
  for (std::size_t n = 0; n < product_sums_.size() / kEach; ++n)
    for (std::size_t k = 0; k < kLags; ++k) {
      const std::size_t to = k + kLags * (n % kLaterals);
      a.mean[to] += product_sums_[n * kEach + k];
      a.difference[to] += product_sums_[n * kEach + kLags + k];
    }
  return a;
}

void Refinement::add_terms(const ImagePair& images) {
  kernels_->data_term(over(grid_.nodes()), images.mean, images.difference, hat_, noise_, terms_, pixels_,
                      grid_, images.layout, images.lines, chunks_);
}

// The robust weights need the noise of these images: that of a first pass.
void Refinement::gather(const ImagePair& images, bool robust, Array<float>& correlation) {
  const SampleGrid& g = grid_;
  const auto local_noise = [&] {
    kernels_->local_noise(over(g.nodes()), terms_, pixels_, model_, correlation, noise_, information_, g.nx,
                          g.ny, kNoiseRadius);
  };
  local_noise();
  if (!robust) return;
  add_terms(images);
  local_noise();
  // Of the last step: what the steps before it are weighed with need not be as exact.
  kernels_->pulse_sums(over(g.nodes()), images.mean, images.difference, noise_, pulses_, g, images.layout,
                       images.lines);
  kernels_->pulse_noise(over(g.nodes()), pulses_, noise_, information_, g.nx, g.ny, kNoiseRadius);
}

// Smoothing lengths l from the median information and strain, and the weights of the edges, w = h l^2 /
// spacing^2 (T2.3).
void Refinement::weigh(const Array<float>& field) {
  const SampleGrid& g = grid_;
  kernels_->local_gradient(over(g.nodes()), field, gradient_, strain_, g.nx, g.ny, kGradientRadius,
                           kGradientRadius);
  const auto f = [](double v) { return static_cast<float>(v); };
  const Smoothing s{f(dx_m_),           f(dy_m_),        f(line_pitch_m_),
                    f(sample_pitch_m_), f(kMinStrain),   f(kStrainChange * kChangeLengthM),
                    f(kShortestM),      f(kLongestM[0]), f(kLongestM[1])};
  const std::size_t informations = information_.size() / width_, strains = strain_.size() / width_;
  constexpr std::size_t kBits = 31;  // each looks at all once more
  const auto terms = [&](std::size_t vectors) { return (vectors + group_ - 1) / group_; };
  kernels_->weigh_edges({{group_}, {group_}, (kBits + 1) * terms(informations) + kBits * terms(strains)},
                        information_, strain_, model_, s, g.nodes(), static_cast<int>(informations),
                        static_cast<int>(strains));
}

void Refinement::step(const Array<float>& field, Array<float>& out, float lateral_limit, float axial_limit,
                      int number) {
  const int stride = gradients_.layout().stride;
  weigh(field);
  kernels_->assemble(over(grid_.nodes()), terms_, noise_, information_, field, gradient_, model_, diagonal_,
                     cross_, rhs_, grid_.nx, grid_.ny, stride);
  PcgOptions options = options_;
  options.relative_residual *= number + 1 == kRefinementSteps ? 1 : kRough;
  gradients_.solve({diagonal_, cross_, model_}, rhs_, correction_, model_,
                   kModel + static_cast<std::size_t>(number) * NodeGradients::kEnd, options);
  kernels_->correct(over(grid_.nodes()), field, correction_, out, grid_.nx, grid_.ny, stride, lateral_limit,
                    axial_limit);
}

PcgResult Refinement::solved(const std::vector<float>& model, int number) {
  return NodeGradients::result(model.data() + kModel +
                               static_cast<std::size_t>(number) * NodeGradients::kEnd);
}

Refinement::Uncertainty Refinement::uncertainty(const Array<float>& field, Array<float>& information,
                                                Array<float>& deviation_m) {
  std::vector<float> model(model_.size());
  Arrival arrival = queue_.fetch(model_, model.data(), model.size());
  // The gradients still are those that the last step pulled towards: the edges' force is the one that it
  // left.
  kernels_->edge_pull(over(grid_.nodes()), field, gradient_, model_, pull_, grid_.nx, grid_.ny);
  kernels_->edge_bias(over(grid_.nodes()), information_, pull_, bias_, grid_.nx, grid_.ny);
  arrival.wait();
  Uncertainty out;
  for (int number = 0; number < kRefinementSteps; ++number)
    if (const PcgResult result = solved(model, number); result.reason != StopReason::kConverged)
      out.unsolved = result;
  auto noise = std::make_shared<NoiseStructure>();
  noise->unit_m = {line_pitch_m_, sample_pitch_m_};
  std::vector<int> footprint, place;
  for (std::size_t c = 0; c < 2; ++c) {
    const SmootherResponse smoother{model[c], model[2 + c], kGradientRadius, kRefinementSteps};
    noise->response[c] = NoiseResponse(smoother, model[kMedian + c], grid_.line_step, grid_.sample_step);
    for (const double step_m : {dx_m_, dy_m_}) {
      const double length = static_cast<double>(model[kLength + c]) / step_m;
      footprint.push_back(std::min(kMaxFootprint, 1 + static_cast<int>(std::lround(length))));
      place.push_back(place_radius(length));
    }
  }
  footprint.insert(footprint.end(), place.begin(), place.end());
  look_up(*noise, footprint, information, deviation_m);
  out.noise = std::move(noise);
  return out;
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
  add([](const NoiseResponse& r) { return r.deviation(); });
  add([](const NoiseResponse& r) { return r.bias_noise(kBiasRadius); });
  add([](const NoiseResponse& r) { return r.bias_over_seen(kBiasRadius); });
  kernels_->uncertainty(over(grid_.nx * ((grid_.ny + kTrustedRows - 1) / kTrustedRows)), information_, bias_,
                        sent(queue_, tables), sent(queue_, radii), information, deviation_m, grid_.nx,
                        grid_.ny, static_cast<float>(noise.response[0].median()),
                        static_cast<float>(noise.response[1].median()), static_cast<float>(line_pitch_m_),
                        static_cast<float>(sample_pitch_m_));
}

}  // namespace teletact::service
