// The model that is touched: immutable once made, shared by any number of touch streams.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "service/tissue/compliance.h"
#include "service/tissue/grid.h"

namespace teletact::service {

class Device;

struct TissueModelOptions {
  double touch_begin_m = 0,
         touch_end_m = 0;      // grid columns that a finger can reach: compliance is kept there
  double thickness_m = 0.010;  // out-of-plane contact width of the finger (T: axes)
};

// Grid, material and supports with the compliance of its lines. Thread-safe; the surface line is condensed in
// the constructor, interior lines (T4.4) on first use.
class TissueModel {
 public:
  TissueModel(TissueGrid, Material, Supports, TissueModelOptions);
  ~TissueModel();
  const TissueGrid& grid() const { return grid_; }
  const Material& material() const { return material_; }
  const Supports& supports() const { return supports_; }
  const TissueModelOptions& options() const { return options_; }
  // The condensed compliance of grid row `line` (0 = the natural surface). Throws std::out_of_range when the
  // row is fixed or absent.
  std::shared_ptr<Compliance> condensed(std::size_t line) const;
  // The same by preconditioned conjugate gradients on `device`, columns computed when asked for and kept.
  std::shared_ptr<Compliance> iterative(std::size_t line, const std::shared_ptr<Device>& device) const;
  // Young's modulus of the element row below the line at column i's neighbourhood, for scales.
  double modulus_near_pa(std::size_t column, std::size_t line) const;

 private:
  TissueGrid grid_;
  Material material_;
  Supports supports_;
  TissueModelOptions options_;
  struct Lines;
  std::unique_ptr<Lines> lines_;
};

}  // namespace teletact::service
