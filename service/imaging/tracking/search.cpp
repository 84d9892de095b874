#include "service/imaging/tracking/search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {

namespace {

constexpr int kNccLaterals = 3;  // NCC_LATERALS of search.cl
constexpr double kCoarseStepAxialM = 1e-3, kCoarseStepLateralM = 2e-3, kFineStepM = 1e-3;
constexpr int kMaxCoarseColumns = 48, kMaxCoarseRows = 128;  // bound the correlation volume
constexpr int kDecimation = 2;                               // of the samples of the windows
constexpr float kSlopeCost = 0.02f;   // correlation that one sample of lag change per coarse step is worth
constexpr double kMaxLags = 1 << 28;  // of the coarse search, all nodes together: 1 GB
constexpr double kLateralStepM = 0.4e-3;    // of the coarse search, about the width of a beam
constexpr float kLateralSlopeCost = 0.25f;  // as kSlopeCost, of one lateral step
constexpr double kMinPeriods = 4;           // of the carrier in a coarse window
// The strain over part of the depth, over the mean compression: a stiff inclusion, the probe's and the
// table's friction leave the softer tissue more than its share.
constexpr double kLocalStrain = 1.6;
constexpr int kSpareLags = 8;  // beyond what the largest strain asks for
constexpr int kFineFirstLag = -4;
constexpr float kFineReach = 8;  // samples: all of them

}  // namespace

SearchPlan::SearchPlan(const RfFrame& frame, const AcquisitionGeometry& g, double largest_strain)
    : samples(static_cast<int>(frame.sample_count)),
      lines(static_cast<int>(frame.line_count)),
      sample_pitch_m(g.sample_pitch_m()),
      line_pitch_m(g.line_pitch_m),
      max_strain(largest_strain) {
  const double dy = sample_pitch_m, dx = line_pitch_m;
  coarse.grid =
      centred_grid(frame, std::max(whole_steps(kCoarseStepLateralM, dx), lines / kMaxCoarseColumns),
                   std::max({kMinStep, whole_steps(kCoarseStepAxialM, dy), samples / kMaxCoarseRows}));
  fine.grid =
      centred_grid(frame, whole_steps(kFineStepM, dx), std::max(kMinStep, whole_steps(kFineStepM, dy)));
  // Nearly incompressible tissue widens by what it is compressed by, about the middle of the probe.
  SearchLags& c = coarse.lags;
  // The fine search looks half of kLateralSearchM further.
  c.lateral_min = static_cast<float>(kLateralSearchM / 2 / dx);
  c.lateral_slope = static_cast<float>(max_strain);
  const float lateral_max = std::max(c.lateral_min, c.lateral_slope * static_cast<float>(lines) / 2);
  c.lateral_step = std::min(whole_steps(kLateralStepM, dx), lines);
  const int sides = static_cast<int>(std::ceil(std::min<float>(lateral_max, static_cast<float>(lines)) /
                                               static_cast<float>(c.lateral_step)));
  c.laterals = 1 + 2 * sides;
  c.first_lateral = -sides * c.lateral_step;
  // The probe's face at rest, nothing moves further than the local strain over the depth above it; else the
  // deepest sample's reach holds everywhere.
  const double deepest_m = g.first_sample_depth_m + samples * dy;
  const bool probe_rests = g.frame == DisplacementFrame::kProbe;
  const double min_m = max_strain * (probe_rests ? g.first_sample_depth_m : deepest_m);
  c.min_reach = static_cast<float>(min_m / dy + kSpareLags);
  c.reach_slope = static_cast<float>(probe_rests ? kLocalStrain * max_strain : 0.0);
  const int max_lag =
      static_cast<int>(std::min<double>(samples, std::ceil(max_strain * deepest_m / dy) + kSpareLags));
  c.chunks = 2 * ((max_lag + 7) / 8);
  c.first = -4 * c.chunks;
  // Under the largest strain the echoes of one window may not move apart by more than half a period.
  const auto period = static_cast<float>(g.sampling_frequency_hz / g.center_frequency_hz);
  const double widest_m = std::max(kMinPeriods, 0.5 / max_strain) * period * dy;
  coarse.window = {std::min(half_width(std::min(kCoarseWindowAxialM, widest_m), dy), samples / 2),
                   std::min(half_width(kCoarseWindowLateralM, dx), lines / 2), kDecimation, c.lateral_step};
  fine.window = {std::min(half_width(kFineWindowAxialM, dy), samples / 2),
                 std::min(static_cast<int>(std::lround(kFineWindowLateralM / 2 / dx)), lines / 2),
                 kDecimation, c.lateral_step};
  const int reach = std::max(c.lateral_step / 2, static_cast<int>(std::lround(c.lateral_min))) + 1;
  fine.lags = {kFineFirstLag, 1, -reach, 1, 2 * reach + 1, kFineReach, 0, static_cast<float>(reach), 0};
  if (static_cast<double>(coarse.volume()) > kMaxLags)
    throw std::invalid_argument(
        "max_strain: the search of so many lines and samples would not fit in memory; give a smaller one, or "
        "a part of the frame");
}

int SearchPlan::margin_samples() const {
  return 4 * coarse.lags.chunks + coarse.window.half_axial + fine.window.half_axial + 16;
}

int SearchPlan::margin_lines() const {
  return std::max(coarse.window.half_lateral - coarse.lags.first_lateral,
                  fine.window.half_lateral - fine.lags.first_lateral) +
         3;
}

std::uint64_t SearchPlan::device_bytes() const {
  return sizeof(float) *
         (coarse.volume() + fine.volume() + coarse.nodes() * (coarse.axial_lags() + coarse.laterals() + 1));
}

SearchKernels::SearchKernels(const Queue& q) {
  const auto build = [&](const char* name) { return q.kernel("search", name, Precision::kFloat); };
  window_energy = build("window_energy"), best_lateral = build("best_lateral");
  laterals_at = build("laterals_at"), ncc = build("ncc"), ncc_peak = build("ncc_peak");
}

Search::Search(const Queue& queue, const SearchPlan& plan, const Padding& padding)
    : queue_(queue), plan_(plan), layout_(padding.layout) {
  for (Array<float>* energy : {&pre_energy_, &post_energy_}) {
    *energy = queue_.array<float>(padding.total);
    queue_.fill_zero(*energy);
  }
  const SearchLevel& c = plan_.coarse;
  coarse_volume_ = queue_.array<float>(c.volume());
  queue_.fill_zero(coarse_volume_);  // where nothing is looked at
  best_lateral_ = queue_.array<float>(c.nodes() * c.axial_lags());
  laterals_at_ = queue_.array<float>(c.nodes() * c.laterals());
  axial_lags_ = queue_.array<int>(c.nodes());
  fine_volume_ = queue_.array<float>(plan_.fine.volume());
}

// sum pre post / sqrt(sum pre^2 sum post^2) over the window around each node, for every lag (T2.1), into
// `volume`.
void Search::correlate(SearchKernels& kernels, const SearchLevel& level, const Array<float>& pre,
                       const Array<float>& post, Array<float>& volume) {
  const SampleGrid& g = level.grid;
  const SearchLags& lags = level.lags;
  const int half_axial = level.window.half_axial;
  const SampleBlocks of_pre{g.first_sample, g.sample_step, g.ny};  // at the nodes alone
  const int margin = half_axial + 8;                               // echoes end so far outside of the frame
  const SampleBlocks of_post = lags.chunks == 1
                                   ? SampleBlocks{g.first_sample + lags.first, g.sample_step, g.ny}
                                   : SampleBlocks{-margin, 8, (plan_.samples + 2 * margin + 7) / 8};
  const auto blocks = static_cast<std::size_t>(std::max(of_pre.count, of_post.count));
  kernels.window_energy({{blocks, static_cast<std::size_t>(plan_.lines), 2}, {16, 1, 1}}, pre, post,
                        pre_energy_, post_energy_, of_pre, of_post, half_axial, kDecimation, layout_);
  const int groups = (lags.laterals + kNccLaterals - 1) / kNccLaterals;
  kernels.ncc(over(g.nodes() * groups * lags.chunks), pre, post, pre_energy_, post_energy_, volume, g,
              layout_, level.window, lags);
}

void Search::coarse(SearchKernels& kernels, const Array<EchoSpan>& spans, const Array<float>& pre,
                    const Array<float>& post, Array<float>& field) {
  const SampleGrid& g = plan_.coarse.grid;
  const SearchLags& lags = plan_.coarse.lags;
  correlate(kernels, plan_.coarse, pre, post, coarse_volume_);
  kernels.best_lateral(over(g.nodes() * lags.chunks), coarse_volume_, spans, best_lateral_, g, lags.chunks,
                       lags.laterals);
  const LagVolume volume{g.nx, g.ny, 8 * lags.chunks, queue_.read(best_lateral_)};
  check_cancelled();
  const auto reach = [&](double length_m) {  // samples that the lag may change by over this length
    return static_cast<int>(std::ceil(plan_.max_strain * length_m / plan_.sample_pitch_m)) + 1;
  };
  const std::vector<float> axial = find_paths(volume, reach(g.sample_step * plan_.sample_pitch_m),
                                              reach(g.line_step * plan_.line_pitch_m), kSlopeCost);
  std::vector<int> whole;
  whole.reserve(axial.size());
  for (const float lag : axial) whole.push_back(static_cast<int>(std::lround(lag)));
  queue_.send(axial_lags_, std::move(whole));
  kernels.laterals_at(over(g.nodes() * lags.laterals), coarse_volume_, spans, axial_lags_, laterals_at_, g,
                      lags.chunks, lags.laterals);
  const LagVolume across{g.nx, g.ny, lags.laterals, queue_.read(laterals_at_)};
  const std::vector<float> lateral = find_paths(across, 1, 1, kLateralSlopeCost);
  std::vector<float> found;
  const int middle = lags.laterals / 2;
  for (std::size_t n = 0; n < axial.size(); ++n) {
    found.push_back((lateral[n] - static_cast<float>(middle)) * static_cast<float>(lags.lateral_step));
    found.push_back(static_cast<float>(lags.first) + axial[n]);
  }
  queue_.send(field, std::move(found));
}

void Search::fine(SearchKernels& kernels, const Array<EchoSpan>& spans, const Array<float>& pre,
                  const Array<float>& warped_post, const Array<float>& start, Array<float>& field,
                  Array<float>& correlation) {
  const SearchLevel& level = plan_.fine;
  correlate(kernels, level, pre, warped_post, fine_volume_);
  kernels.ncc_peak(over(level.grid.nodes()), fine_volume_, spans, start, field, correlation, level.grid,
                   level.lags.first, level.lags.first_lateral, level.lags.laterals);
}

namespace {

constexpr int kBlock = 8;  // lags that are worked on at once: the compiler's vectors

// Sums up over the four directions; per node `stride` lags, whole blocks, those that do not exist at
// infinity.
class Aggregator {
 public:
  Aggregator(const LagVolume& v, float slope_cost)
      : lags_(v.lag_count), stride_((v.lag_count + kBlock - 1) / kBlock * kBlock), slope_cost_(slope_cost) {
    const auto nodes = static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny);
    grow(costs_, nodes * static_cast<std::size_t>(stride_), std::numeric_limits<float>::infinity());
    grow(sum_, costs_.size());
    for (std::size_t node = 0; node < nodes; ++node) {
      if (node % static_cast<std::size_t>(v.nx) == 0) check_cancelled();
      for (std::size_t d = 0; d < static_cast<std::size_t>(lags_); ++d)
        costs_[node * static_cast<std::size_t>(stride_) + d] =
            1 - v.correlation[node * static_cast<std::size_t>(lags_) + d];
    }
  }

  // Along one line of nodes: first, first + step, ...
  void along(int first, int step, int count, int reach) {
    check_cancelled();
    // `reach` cells of infinity on both sides stand for lags that do not exist.
    const auto size = static_cast<std::size_t>(stride_) + 2 * static_cast<std::size_t>(reach);
    before_.assign(size, std::numeric_limits<float>::infinity());
    now_ = before_;
    for (int n = 0; n < count; ++n) {
      const auto at = static_cast<std::size_t>(first + n * step) * static_cast<std::size_t>(stride_);
      float* const here = now_.data() + reach;
      if (n == 0)
        std::copy_n(costs_.data() + at, stride_, here);
      else
        advance(before_.data() + reach, costs_.data() + at, here, reach);
      float* const sum = sum_.data() + at;
      for (int d = 0; d < stride_; d += kBlock)
        for (int k = d; k < d + kBlock; ++k) sum[k] += here[k];
      std::swap(before_, now_);
    }
  }

  const float* sum(int node) const { return sum_.data() + node * static_cast<std::ptrdiff_t>(stride_); }

 private:
  // L(p, d) = C(p, d) + min_e (L(previous, d + e) + slope_cost |e|) - min L(previous, .)
  void advance(const float* __restrict before, const float* __restrict cost, float* __restrict here,
               int reach) const {
    float least[kBlock];
    std::copy_n(before, kBlock, least);
    for (int d = kBlock; d < stride_; d += kBlock)
      for (int k = 0; k < kBlock; ++k) least[k] = before[d + k] < least[k] ? before[d + k] : least[k];
    const float least_of_all = *std::min_element(least, least + kBlock);
    for (int d = 0; d < stride_; d += kBlock) {
      float best[kBlock];
      std::copy_n(before + d, kBlock, best);
      for (int e = 1; e <= reach; ++e) {
        const float penalty = slope_cost_ * static_cast<float>(e);
        for (int k = 0; k < kBlock; ++k) {
          const float below = before[d + k - e], above = before[d + k + e];
          const float other = (below < above ? below : above) + penalty;
          best[k] = other < best[k] ? other : best[k];
        }
      }
      for (int k = 0; k < kBlock; ++k) here[d + k] = best[k] + (cost[d + k] - least_of_all);
    }
  }

  std::vector<float> costs_, sum_, before_, now_;
  int lags_, stride_;
  float slope_cost_;
};

float best_lag(const float* cost, int lags) {
  const int best = static_cast<int>(std::min_element(cost, cost + lags) - cost);
  if (best == 0 || best == lags - 1) return static_cast<float>(best);
  const float before = cost[best - 1], after = cost[best + 1];
  const float curvature = before - 2 * cost[best] + after;
  const float fraction =
      curvature > 1e-6f ? std::clamp(0.5f * (before - after) / curvature, -0.5f, 0.5f) : 0.0f;
  return static_cast<float>(best) + fraction;
}

}  // namespace

std::vector<float> find_paths(const LagVolume& v, int reach_down, int reach_across, float slope_cost) {
  Aggregator aggregate(v, slope_cost);
  for (int i = 0; i < v.nx; ++i) {
    aggregate.along(i, v.nx, v.ny, reach_down);
    aggregate.along(i + v.nx * (v.ny - 1), -v.nx, v.ny, reach_down);
  }
  for (int j = 0; j < v.ny; ++j) {
    aggregate.along(v.nx * j, 1, v.nx, reach_across);
    aggregate.along(v.nx * j + v.nx - 1, -1, v.nx, reach_across);
  }
  std::vector<float> path;
  path.reserve(static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny));
  for (int node = 0; node < v.nx * v.ny; ++node) {
    if (node % v.nx == 0) check_cancelled();
    path.push_back(best_lag(aggregate.sum(node), v.lag_count));
  }
  return path;
}

}  // namespace teletact::service
