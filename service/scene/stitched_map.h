// Young's modulus of a scene, stitched from its windows onto uniform cells of about 0.5 mm.
//
// A cell is kMeasured where at least half of the image nodes in it are valid; its modulus is their harmonic
// mean, because what was measured is strain, E = sigma / eps, and the mean strain is the unbiased one.
// Invalid cells of a published window are kExtended: grown layer by layer from the measured ones, each the
// geometric mean (mean of log E) of its neighbours that are known already. Where windows overlap the newest
// counts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/frame.h"
#include "service/scene/cell_blocks.h"
#include "service/scene/evidence.h"
#include "service/scene/geometry.h"

namespace teletact::service {

// What elastography hands over: E and its validity on the image grid, window coordinates (x = 0 at
// window_x_m of the scene, y = 0 at the probe face).
struct WindowEstimate {
  double window_x_m = 0;  // left border in the scene
  double width_m = 0;     // the window covers [window_x_m, window_x_m + width_m)
  ImageGrid grid;
  Field youngs_modulus_pa;
  std::vector<std::uint8_t> valid;
  Field log_deviation = {};      // standard deviation of log E; empty: not known
  BMode b_mode = {};             // in window coordinates; no nodes: there is none
  WindowEvidence evidence = {};  // measured_share and log_deviation are found when it is published
};

class StitchedMap {
 public:
  static constexpr double kCellM = 0.0005;
  // Pixels further than this factor from the window's median are taken as invalid.
  static constexpr double kLargestContrast = 100;

  // `account`: in whose name its cells are held.
  explicit StitchedMap(const SceneGeometry&, const MemoryAccount& account = {});

  // Writes one window's cells. Throws std::invalid_argument for sizes that do not fit, Error(kPrecondition)
  // when too little of it is valid, MemoryRefused; the map is unchanged then.
  void paste(const WindowEstimate&);

  // Harmonic mean of E (Pa) over [x0, x1] x [y0, y1] (m). Columns never published take the nearest published
  // one. Throws std::logic_error when nothing is published.
  double mean_modulus_pa(double x0_m, double x1_m, double y0_m, double y1_m) const;
  // Modulus (Pa) of the cell at (x, y) (m); NaN where none was measured and outside the tissue.
  double measured_modulus_pa(double x_m, double y_m) const;
  // Standard deviation of its logarithm; NaN there, and where none came with the window.
  double measured_log_deviation(double x_m, double y_m) const;
  // Of the cells of the tissue that [x0, x1] x [y0, y1] touches.
  struct Measured {
    double share = 0;          // that is measured
    double log_deviation = 0;  // median standard deviation of the measured ones' log E; 0: not known
  };
  double measured_share(double x0_m, double x1_m, double y0_m, double y1_m) const;
  Measured measured(double x0_m, double x1_m, double y0_m, double y1_m) const;

  std::size_t nx() const { return nx_; }
  std::size_t ny() const { return ny_; }
  double cell_x_m() const { return cell_x_m_; }
  double cell_y_m() const { return cell_y_m_; }
  // Cell (i, j) at i + nx j; 0 Pa where unknown.
  std::vector<float> youngs_modulus_pa() const;
  std::vector<CellState> states() const;
  std::vector<float> log_deviation() const;  // NaN where not known
  const CellBlocks& cells() const { return cells_; }
  // Restores what the three accessors above gave (no deviation: not known). Throws std::invalid_argument when
  // it does not fit or a known cell is not a finite positive modulus.
  void restore(const std::vector<float>& youngs_modulus_pa, const std::vector<CellState>& states,
               const std::vector<float>& log_deviation);

 private:
  std::size_t column(double x_m) const;
  std::size_t row(double y_m) const;
  struct Box;
  Box cells_touched(double x0_m, double x1_m, double y0_m, double y1_m) const;
  std::optional<Cell> measured_cell(double x_m, double y_m) const;
  float deviation_of(const WindowEstimate&, std::size_t i, std::size_t j) const;
  // `value` of each cell.
  template <class Value>
  auto each(Value value) const;
  // The window's cells in columns [first, first + columns), 0 Pa where not measured.
  std::vector<float> resample(const WindowEstimate&, std::size_t first, std::size_t columns) const;
  void index_columns();
  std::size_t nx_, ny_;
  double cell_x_m_, cell_y_m_;
  CellBlocks cells_;
  std::vector<std::uint32_t> source_column_;  // nearest published column
};

// What a window's neighbours, and the window itself before, tell about the tissue; empty without a map.
KnownModulus known_modulus(const std::shared_ptr<const StitchedMap>&);

}  // namespace teletact::service
