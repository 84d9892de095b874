// The tissue under the probe as a forward model (T3.1): what a modulus map would have shown. Plane strain or
// plane stress, Q1 (T4).
#pragma once

#include <Eigen/SparseCore>
#include <cstddef>
#include <list>
#include <memory>
#include <vector>

#include "service/base/memory.h"
#include "service/imaging/modulus/sparse_factor.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/frame.h"
#include "service/tissue/grid.h"

namespace teletact::service {

// Answer of the strip to a face that is pushed down by 1 m (linear, so any unit).
struct StripResponse {
  std::vector<double> stress;        // E eps_yy at the centre of every element, Pa (< 0); eps_yy where E = 1
  std::vector<double> displacement;  // [dof], 1 under the probe
  double force_n_per_m = 0;          // on the probe per metre of thickness, > 0
};

// An elastic solid in plane strain: Poisson's ratio, and Young's modulus over that of the tissue it stands
// for.
struct InPlaneStrain {
  double poisson_ratio, modulus;
};

// The strip of a window with up to 200 mm of context on each side, cut at the tissue's sides; bottom bonded,
// sides free, u_y prescribed on the surface under the whole window, frictionless. Elements of 1 mm under the
// probe, growing sideways from it. A host sparse factor: at this size (some 4000 nodes) it beats an iteration
// (T4.8).
class StripModel {
 public:
  // Throws std::invalid_argument naming the field of the extent.
  StripModel(const TissueExtent&, double window_width_m);
  const TissueGrid& grid() const { return grid_; }  // window coordinates: x_m from -left to width + right
  // Columns of nodes under the probe, both inclusive.
  std::size_t first_column() const { return first_column_; }
  std::size_t last_column() const { return last_column_; }
  // Poisson's ratio of the plane-strain tissue that moves like this one: nu, in plane stress nu / (1 + nu).
  double poisson_ratio() const { return equal_.poisson_ratio; }
  // Its Young's modulus over this one's: 1, in plane stress (1 + 2 nu) / (1 + nu)^2.
  double modulus_factor() const { return equal_.modulus; }
  // Young's modulus (Pa) of every element, > 0. Not thread-safe.
  StripResponse solve(const std::vector<double>& youngs_modulus_pa);
  // d log(force) / d nu of homogeneous tissue at the stated nu, the modulus held: how much of the load the
  // pressure carries, which no displacement tells. `homogeneous`: solve() of a uniform modulus of 1 Pa.
  double log_force_slope(const StripResponse& homogeneous) const;
  // How the displacement changes with the modulus, by the factor of the latest solve(), whose response is
  // `at`:
  //   change: K^-1 (- sum_e change_pa_e K_e u_e), [dof], 0 where the displacement is prescribed
  //   sensitivity (T3.3): per element - (K^-1 load) . K_e u_e, the derivative of load . u by its modulus
  //   (adjoint)
  std::vector<double> change(const StripResponse& at, const std::vector<double>& change_pa);
  std::vector<double> sensitivity(const StripResponse& at, const std::vector<double>& load);
  // change() with E of each group of elements grown alike by 1 (of log E): the axial displacement, [node]
  // [group]. `group_of`: of every element, -1 for none.
  using Groups = std::vector<int>;
  using NodeColumns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  NodeColumns axial_changes(const StripResponse& at, const std::vector<double>& youngs_modulus_pa,
                            const Groups& group_of, int groups);
  // d log(force) / d log(E) of each element: its share of the energy.
  std::vector<double> force_shares(const StripResponse& at,
                                   const std::vector<double>& youngs_modulus_pa) const;
  // Values of the elements at the nodes of an image grid, bilinear between centres; NaN below the tissue.
  Field on_image(const std::vector<double>& element_values, const ImageGrid&) const;
  // Young's modulus of every element from a map that has NaN where nothing is said: geometric mean over the
  // element, neighbours where the map says nothing. Beside the window: `known` (may be empty; scaled to meet
  // the map at the border), else the map mirrored over 20 mm (an inclusion across the border goes on behind
  // it), else `background`.
  std::vector<double> on_elements(const Field& youngs_modulus, const ImageGrid&, double background,
                                  const KnownModulus& known = {}) const;

 private:
  using Sparse = Eigen::SparseMatrix<double>;
  void number_unknowns(double window_width_m);
  void lay_out();
  struct WindowMap {
    std::size_t first = 0, last = 0;  // columns of elements under the probe
    std::vector<double> logarithm;    // of Young's modulus, [row][column - first]
  };
  WindowMap window_map(const Field& youngs_modulus, const ImageGrid&) const;
  double logarithm_at(const WindowMap&, double x_m, std::size_t row) const;
  double known_over_element(const KnownModulus&, std::size_t column, double y_m) const;
  double matching_shift(const KnownModulus&, bool left, const WindowMap&) const;
  void fill(const std::vector<double>& youngs_modulus_pa);
  void pull(const StripResponse& at, std::size_t element, double change_pa, auto&& add) const;
  // a . K_e b of each element, K_e of 1 Pa.
  std::vector<double> products(const std::vector<double>& a, const std::vector<double>& b) const;
  std::vector<double> back_substituted(const std::vector<double>& force) const;

  TissueGrid grid_;
  double window_x_m_, window_width_m_;
  Plane plane_;
  double stated_poisson_ratio_;
  InPlaneStrain equal_;
  std::size_t first_column_ = 0, last_column_ = 0;
  std::vector<Eigen::Matrix<double, 8, 8>> element_;  // K_e of 1 Pa, one per column of elements
  std::vector<int> unknown_;                          // per degree of freedom; -1 at rest, -2 pushed by 1
  int unknown_count_ = 0;
  Sparse stiffness_;       // of the unknowns
  Eigen::VectorXd load_;   // of the prescribed displacement
  std::vector<int> slot_;  // [element][row][column] -> value of stiffness_, -1 where there is none
  SparseFactor factor_;
};

// Models of the latest geometries with their response to homogeneous tissue of 1 Pa. Windows with the same
// context share one. Used by one thread at a time; those that nobody holds are given back when others need
// room.
class StripCache {
 public:
  struct Entry {
    Entry(const TissueExtent&, double window_width_m, Charge);
    Charge charge;
    StripModel model;
    StripResponse homogeneous;
    double log_force_slope;
  };
  // In whose name models are held that are made from now on.
  void charge_to(const MemoryAccount& account) { account_ = account; }
  // Throws as StripModel, and MemoryRefused. The entry lives as long as it is held or among the latest kMax.
  std::shared_ptr<Entry> get(const TissueExtent&, double window_width_m);
  static constexpr std::size_t kMax = 32;

 private:
  struct Key {
    double window_x_m, right_m, depth_m, poisson_ratio, width_m;
    Plane plane;
    bool same(const Key&) const;
  };
  class Kept;
  MemoryAccount account_;
  std::list<std::shared_ptr<Kept>> kept_;  // latest used first
};

}  // namespace teletact::service
