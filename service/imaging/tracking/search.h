// Where the displacement of a pair is looked for by normalised cross-correlation (T2.1), kernels/search.cl:
// over all lags on a coarse grid, then a little around that on a finer one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {

// Half widths in samples and lines, and every how many of them are read. An argument of kernels: Window.
struct SearchWindow {
  int half_axial = 0, half_lateral = 0, sample_stride = 1, line_stride = 1;
};
static_assert(sizeof(SearchWindow) == 4 * sizeof(int));

// An argument of kernels: Lags.
struct SearchLags {
  int first = 0, chunks = 0;                              // axial lags first .. first + 8 chunks - 1
  int first_lateral = 0, lateral_step = 1, laterals = 0;  // lateral lags, lines
  float min_reach = 0, reach_slope = 0;                   // of axial ones, samples: least + slope * sample
  float lateral_min = 0, lateral_slope = 0;               // lines: or slope * distance from the middle
};
static_assert(sizeof(SearchLags) == 9 * sizeof(int));

// An argument of kernels: Blocks.
struct SampleBlocks {
  int first = 0, step = 1, count = 0;
};
static_assert(sizeof(SampleBlocks) == 3 * sizeof(int));

struct SearchLevel {
  SampleGrid grid;
  SearchWindow window;
  SearchLags lags;
  std::size_t nodes() const { return static_cast<std::size_t>(grid.nodes()); }
  std::size_t axial_lags() const { return 8 * static_cast<std::size_t>(lags.chunks); }
  std::size_t laterals() const { return static_cast<std::size_t>(lags.laterals); }
  std::size_t volume() const { return nodes() * laterals() * axial_lags(); }
};

struct SearchPlan {
  // Throws std::invalid_argument where the coarse search would not fit in memory. Reads no sample.
  SearchPlan(const RfFrame&, const AcquisitionGeometry&, double max_strain);
  int samples, lines;
  double sample_pitch_m, line_pitch_m, max_strain;
  SearchLevel coarse, fine;
  // Zeros that are read around the frame.
  int margin_samples() const;
  int margin_lines() const;
  std::uint64_t device_bytes() const;  // of a Search's buffers but for two images
};

struct SearchKernels {
  explicit SearchKernels(const Queue&);
  Kernel window_energy, best_lateral, laterals_at, ncc, ncc_peak;
};

// Hop-free start for the displacement: of all correlation peaks of a node, the one that its neighbours can
// reach within the largest strain (dynamic programming along the rows and columns of the coarse grid).
struct LagVolume {
  int nx = 0, ny = 0, lag_count = 0;
  std::vector<float> correlation;  // [node][lag], node i + nx j
};

// Lag of every node, in lags from the first, with a parabolic fraction. Minimises, summed over the four
// directions,
//   L(p, d) = 1 - correlation(p, d) + min over |e| <= reach of L(previous, d + e) + slope_cost |e|
// (Hirschmueller's semi-global aggregation). reach_down: per coarse step along the columns, reach_across
// along the rows.
std::vector<float> find_paths(const LagVolume&, int reach_down, int reach_across, float slope_cost);

class Search {
 public:
  Search(const Queue&, const SearchPlan&, const Padding&);
  // The lags on the coarse grid that neighbours can reach within the largest strain (find_paths), 2 per node.
  // Nodes outside of the spans, one for each line of pre, have no say.
  void coarse(SearchKernels&, const Array<EchoSpan>& spans, const Array<float>& pre, const Array<float>& post,
              Array<float>& field);
  // On the fine grid: `start` and the peak beside it, 2 per node; correlation there.
  void fine(SearchKernels&, const Array<EchoSpan>& spans, const Array<float>& pre,
            const Array<float>& warped_post, const Array<float>& start, Array<float>& field,
            Array<float>& correlation);

 private:
  void correlate(SearchKernels&, const SearchLevel&, const Array<float>& pre, const Array<float>& post,
                 Array<float>& volume);
  Queue queue_;
  SearchPlan plan_;
  ImageLayout layout_;
  Array<float> pre_energy_, post_energy_;  // of the windows
  Array<float> coarse_volume_, fine_volume_, best_lateral_, laterals_at_;
  Array<int> axial_lags_;
};

}  // namespace teletact::service
