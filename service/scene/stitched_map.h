// Young's modulus of a scene, stitched from its windows onto uniform cells of about 0.5 mm.
//
// A cell is kMeasured where at least half of the image nodes in it are valid; its modulus is their harmonic
// mean, because what was measured is strain, E = sigma / eps, and the mean strain is the unbiased one.
// Invalid cells of a published window are kExtended: grown layer by layer from the measured ones, each the
// geometric mean (mean of log E) of its neighbours that are known already. Where windows overlap the newest
// counts.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "service/base/memory.h"
#include "service/base/warning.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/frame.h"
#include "service/scene/geometry.h"

namespace teletact::service {

// The cells of a scene's map, in blocks of columns. A copy shares its blocks with the one that it was made
// from; a block is made or copied when it is first written to, and where nothing is published there is none.
// So an empty scene costs next to nothing, and a publication what it changes.
enum class CellState : std::uint8_t { kUnknown = 0, kExtended = 1, kMeasured = 2 };

struct Cell {
  float modulus_pa = 0;
  CellState state = CellState::kUnknown;
  float log_deviation = std::numeric_limits<float>::quiet_NaN();
};

// Not thread-safe while it is written to; copies are independent of each other.
class CellBlocks {
 public:
  static constexpr std::size_t kColumns = 64;  // of a block, 32 mm

  CellBlocks(std::size_t nx, std::size_t ny, MemoryAccount account)
      : nx_(nx),
        ny_(ny),
        account_(std::move(account)),
        blocks_((nx + kColumns - 1) / kColumns),
        own_(blocks_.size()) {}
  CellBlocks(const CellBlocks& other)
      : nx_(other.nx_),
        ny_(other.ny_),
        account_(other.account_),
        blocks_(other.blocks_),
        own_(blocks_.size()) {}
  CellBlocks& operator=(const CellBlocks&) = delete;

  Cell at(std::size_t i, std::size_t j) const {
    const Block* const block = blocks_[i / kColumns].get();
    if (!block) return {};
    const std::size_t n = i % kColumns + kColumns * j;
    return {block->modulus_pa[n], block->states[n], block->log_deviation[n]};
  }
  // Columns [begin, end) may be written to afterwards. Throws MemoryRefused; nothing is changed then.
  void make_writable(std::size_t begin, std::size_t end) {
    const std::size_t first = begin / kColumns, last = (end + kColumns - 1) / kColumns;
    auto made = own_;
    for (std::size_t b = first; b < last; ++b)
      if (!made[b]) made[b] = std::make_shared<Block>(blocks_[b].get(), ny_, account_);
    own_.swap(made);
    for (std::size_t b = first; b < last; ++b) blocks_[b] = own_[b];
  }
  void set(std::size_t i, std::size_t j, const Cell& cell) {
    Block& block = *own_[i / kColumns];
    const std::size_t n = i % kColumns + kColumns * j;
    block.modulus_pa[n] = cell.modulus_pa, block.states[n] = cell.state;
    block.log_deviation[n] = cell.log_deviation;
  }
  std::size_t blocks() const { return blocks_.size(); }
  // Of a block: another number whenever it is written to anew in a later copy; 0: there is none.
  std::uint64_t stamp(std::size_t block) const { return blocks_[block] ? blocks_[block]->stamp : 0; }
  // Blocks of this one that `other` has too.
  std::size_t shared_with(const CellBlocks& other) const {
    std::size_t shared = 0;
    for (std::size_t b = 0; b < blocks_.size(); ++b) shared += blocks_[b] && blocks_[b] == other.blocks_[b];
    return shared;
  }

 private:
  struct Block {
    Block(const Block* from, std::size_t ny, const MemoryAccount& account)
        : charge(account.charge(Place::kHost, "maps", kColumns * ny * kCellBytes)),
          modulus_pa(from ? from->modulus_pa : std::vector<float>(kColumns * ny, Cell().modulus_pa)),
          states(from ? from->states : std::vector<CellState>(kColumns * ny, Cell().state)),
          log_deviation(from ? from->log_deviation
                             : std::vector<float>(kColumns * ny, Cell().log_deviation)) {}
    static constexpr std::size_t kCellBytes = 2 * sizeof(float) + sizeof(CellState);
    const std::uint64_t stamp = use_stamp();
    Charge charge;
    std::vector<float> modulus_pa;
    std::vector<CellState> states;
    std::vector<float> log_deviation;
  };
  std::size_t nx_, ny_;
  MemoryAccount account_;
  std::vector<std::shared_ptr<const Block>> blocks_;
  std::vector<std::shared_ptr<Block>> own_;  // those of them that were made here
};

// What a window's modulus was made of and what makes it doubtful, kept with the window.
struct WindowEvidence {
  // What makes the estimate doubtful, each "name: words for people".
  std::vector<std::string> warnings;
  double log_deviation = 0;  // median standard deviation of log E over the measured cells; 0: not known
  double correlation_m = 0;  // errors of log E at two places correlate by exp(-distance / it); 0: not known
  // Parts of log_deviation: of the force sensor, over the force; of the contact area.
  double force_relative_deviation = 0, area_relative_deviation = 0;
  double background_modulus_pa = 0, quality = 0;
  double measured_share = 0;  // of the window's cells; the rest is extended from them
  // When the last byte of its RF came in; the epoch where that is not known (read from disk after a restart).
  std::chrono::steady_clock::time_point taken_in{};
  double common_deviation = 0;  // part of log_deviation that all of the window's places share
};

// A window that no other one adjoins: its modulus' scale could not be compared with a neighbour's.
inline std::string lone_warning() {
  return Warning{WarningFlag::kLone,
                 "no window adjoins this one; its scale, which the probe's force sets, could not be compared "
                 "with a neighbour's"}
      .line();
}

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
