// A patch of the surface of solid tissue, or of a row of nodes below it, is pressed (T8.2): conjugate
// gradients on the whole block, preconditioned by layered tissue under the same patch, on the device.
//
// Find u and forces p with  K u = B^T p,  B u + C p = w:  B picks the patch's unknowns, w is how far they are
// pushed, C how far each gives way to its own force (the tip's skin; 0 for a rigid tip). That minimises
// u K u / 2 + p C p / 2 under the constraint, and A = K + B^T C^-1 B is what conjugate gradients see. They
// start from the layered tissue's contact and keep the constraint at every step: each preconditioned residual
// is corrected by q = (S0 + C)^-1 B z0, S0 the layered row's compliance (Gould, Hribar and Nocedal 2001,
// where C = 0).
//
// What is bounded, at every iteration, is the energy norm of the error (RadauBound): the eigenvalues of
// the preconditioned operator are not below min E / E0.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "service/solver/pcg.h"
#include "service/tissue/solid/layered_factor.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// Unknowns of a row of nodes, i + nx (k + nz c) for component c of node (i, k), each once.
struct SurfacePatch {
  std::vector<std::size_t> unknowns;
  Eigen::VectorXd skin_m_n;  // C, >= 0
};

struct SolidSolution {
  Eigen::VectorXd force_n;         // p, of each unknown of the patch
  Eigen::VectorXd displacement_m;  // B u; where the patch is pushed, w - C p
  // Energy of the tissue and the skins, J: too large where the patch is pushed, too small where it is loaded;
  // by how much, at most.
  double energy_j = 0, energy_error_j = 0;
  std::size_t iterations = 0;
  StopReason reason = StopReason::kRunning;
  bool certified = true;  // false where rounding has broken the bound and it shows
  // What rounding may add to the relative error: it breaks the bound before that shows (T8.3).
  double rounding = 0;
  // ||e||_A / ||u||_A, at most: by the bound, and that with rounding.
  double bounded_error() const;
  double relative_error() const { return bounded_error() + rounding; }
};

struct SolidOptions {
  double relative_error = 1e-6;  // ||e||_A / ||u||_A; what lies below the rounding is not tried for
  std::size_t min_iterations = 0, max_iterations = 200;
  // A push begins at the last one's solution, where that was of the same patch, known to better than its own
  // size, and this was set, too: what changed little since is found in few iterations.
  bool from_last = false;
  // Sees every iterate, without its forces and displacements; where it says false, that one is the last.
  std::function<bool(const SolidSolution&)> watch = {};
};

// A row of nodes that is touched: 0 the surface, whose condition costs nothing; below it each step of
// conjugate gradients solves the layers twice. `layered`: its compliance in layered tissue, the block's own.
struct SolidRow {
  std::size_t index = 0;
  SurfaceCompliance layered;
};

// What the row moves by under some forces beyond the layered tissue's, all its 3 nx nz unknowns, m; and
// how much of it the last step of the preconditioner brought: about what it may still be off by.
struct RowExcess {
  Eigen::VectorXd moved_m, last_m;
};

// The modulus of tissue on the device. A solver's factor depends on `layers` and the Poisson ratio alone, so
// it solves any modulus on its grid (T8.7).
template <class T>
struct SolidModulus {
  // `layers`: those of the factor. Throws as validate() does.
  SolidModulus(const Queue&, const SolidTissue&, LayeredTissue layers);
  const LayeredTissue layers;
  const double rounding;       // what it may add to the relative error of any solution (T8.3)
  Array<T> youngs_modulus_pa;  // [layer][z][x]
};

template <class T>
class SolidSolver {
 public:
  // Throws as validate() does.
  SolidSolver(const Queue&, const SolidTissue&);
  // What it solves: from the beginning its tissue's, then that of the last use().
  const std::shared_ptr<const SolidModulus<T>>& modulus() const { return modulus_; }
  // From now on, until the next solution is over and what it leaves is read. It must be on this grid, beside
  // this solver's layers.
  void use(std::shared_ptr<const SolidModulus<T>> modulus) { modulus_ = std::move(modulus); }
  // Where patches lie: from the beginning on the surface, then on the row of the last at(). Their unknowns
  // are counted as the surface's. It must be of this grid and this solver's layers.
  const std::shared_ptr<const SolidRow>& row() const { return row_; }
  void at(std::shared_ptr<const SolidRow> row) { row_ = std::move(row), pushed_.reset(); }
  // Throws std::invalid_argument where the patch is not one of this row.
  SolidSolution push(const SurfacePatch&, const Eigen::VectorXd& w, const SolidOptions& = {});
  // Under given forces instead (N), with no skin: K u = B^T p.
  SolidSolution load(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& p,
                     const SolidOptions& = {});
  // Of the last solution. Throws std::domain_error where it is not finite.
  RowExcess excess();
  // The next push begins anew.
  void forget_last() {
    if (pushed_) pushed_->force_n.resize(0);
  }
  // Displacement of the last solution, or of the iterate that is watched, [plane = 3 row + component][z][x].
  std::vector<T> displacement() const { return queue_.read(u_[at(last_)]); }
  const LayeredTissue& layers() const { return modulus_->layers; }
  double rounding() const { return modulus_->rounding; }  // of every solution

 private:
  using Components = typename LayeredPreconditioner<T>::Components;
  // A patch in the device's arrays: pushed, or loaded.
  struct Patch {
    int count = 0;
    Components components;
    bool pushed = true;
  };
  // The patch of the last push, which is on the device, and so is the solution unless force_n is empty.
  struct Pushed {
    SurfacePatch patch;
    Patch set;
    Eigen::LLT<Eigen::MatrixXd> felt;  // S0 + C
    Eigen::VectorXd w, force_n;
  };
  Patch set_patch(const std::vector<std::size_t>& unknowns, bool pushed);
  Pushed set_pushed(const SurfacePatch&);
  std::size_t row_begin() const { return 3 * row_->index * grid_.columns(); }  // in a field
  void solve_layers(const Array<T>& r, Array<T>& z);                           // z = K0^-1 r
  // u: how layered tissue moves under the patch's forces.
  void move_layers(const Components&, Array<T>& u);
  // Sets u to the layered tissue's answer to the patch's forces, and r to what that leaves of them.
  void begin(const Patch&, const Eigen::VectorXd& force_n);
  // The last solution and the layered tissue's answer to forces of `more_n`; `force_n`: of both.
  void begin_from_last(const Patch&, const Eigen::VectorXd& more_n, const Eigen::VectorXd& force_n);
  void write_forces(const Patch&, const Eigen::VectorXd& force_n);
  // Conjugate gradients from there; `twice_energy`: of the beginning.
  SolidSolution iterate(const Patch&, double twice_energy, const SolidOptions&);
  // What iteration k begins with: u and r of the last one's step, z, r . z in parts.
  void precondition(const Patch&, std::size_t k);
  void precondition_joined(const Patch&, std::size_t k);
  // q of the patch from how the tissue would move, `field`, and p of the last step.
  void project(const Patch&, const Array<T>& field, std::size_t k);
  // d = z + beta d and dq alike, K d + B^T dq, and d . that in parts. parts: of r . z; 0: at the start, d =
  // z.
  void turn(const Array<T>& z, int parts, int patch_row, std::size_t k);
  // sign times the patch's values, with zeros between, in the planes of a field from `begin` on.
  void spread(const Array<T>& values, Array<T>& field, T sign, const Components&, std::size_t begin);
  // of_field field + sign B^T values.
  void add_patch(const Array<T>& values, const Array<T>& field, Array<T>& out, T of_field, T sign);
  // Of what the next iteration makes anew while the last is still asked for.
  std::size_t at(std::size_t k) const { return ahead_ ? k % 2 : 0; }
  Eigen::VectorXd row_of(const Array<T>& field) const;
  // Of a . b in parts, from `first` on.
  void sum_products(const Array<T>& a, const Array<T>& b, Array<T>& sums, std::size_t first);
  double dot(const Array<T>& a, const Array<T>& b);
  Queue queue_;
  SolidGrid grid_;
  std::shared_ptr<const SolidModulus<T>> modulus_;
  LayeredPreconditioner<T> preconditioner_;
  std::shared_ptr<const SolidRow> row_;
  // A GPU goes ahead of the host by an iteration, so that it never waits; on a processor a wait costs less
  // than an iteration in vain.
  bool ahead_;
  std::size_t width_ = 1, group_ = 1, chunk_ = 1, chunks_ = 1, last_ = 0, last_p_ = 0;
  int nx_, nz_, rows_, groups_, parts_;  // groups: of `width_` unknowns; parts: of r . z
  Array<T> stiffness_;
  std::array<Array<T>, 2> u_, r_, d_, p_;  // the second where it goes ahead
  std::optional<Pushed> pushed_;
  Array<T> z_, kd_, surface_;
  Array<T> marks_, partial_;  // kernels/solid_marks.clh
  Array<int> unknowns_, slots_;
  Array<T> inverse_, q_, dq_;
  Kernel step_, back_, surface_step_, apply_, direction_, dot_, sum_, add_, project_, spread_;
};

}  // namespace teletact::service
