#include "service/tissue/elasticity_correction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "service/solver/multigrid.h"

namespace teletact::service {
namespace {

// T: of vectors and operator; W: of multigrid.
template <class T, class W>
class Correction : public ElasticityCorrection {
 public:
  Correction(const Queue& queue, const ScaledTissue& tissue, std::size_t capacity, const PcgOptions& options)
      : queue_(queue),
        tissue_(tissue),
        operator_(queue, tissue),
        multigrid_(queue, {tissue.grid.x_m, tissue.grid.y_m}),
        pcg_(queue, tissue.grid.dofs(), capacity, options) {
    for (Array<T>* a : {&r_, &load_, &x_}) *a = queue.array<T>(capacity * tissue.grid.dofs());
    set_multigrid();
  }

  std::vector<PcgResult> solve(const Problem& problem, std::span<double> correction) override {
    const std::vector<double> scale = scales(problem.count, problem.residual);
    solved_scale_ = scale;
    write(problem.residual, scale, r_);
    write(problem.load, scale, load_);
    // With K = E_ref K' and r = scale r': x = scale / E_ref x', energies scale^2 / E_ref times those of x'.
    std::vector<double> energy = problem.initial_energy, error = problem.absolute_error;
    for (std::size_t q = 0; q < energy.size(); ++q) energy[q] *= tissue_.reference_pa / (scale[q] * scale[q]);
    for (std::size_t q = 0; q < error.size(); ++q) error[q] *= std::sqrt(tissue_.reference_pa) / scale[q];
    pcg_.options().relative_error = problem.relative_error;
    std::vector<PcgResult> results =
        pcg_.solve(operator_, multigrid_, problem.count, r_, load_, x_, energy, error);
    for (std::size_t q = 0; q < problem.count; ++q) {
      const double squared = scale[q] * scale[q] / tissue_.reference_pa;
      results[q].recursive_residual *= scale[q];
      for (double* value :
           {&results[q].squared_error, &results[q].squared_energy, &results[q].squared_decrease})
        *value *= squared;
    }
    read(x_, scale, 1 / tissue_.reference_pa, correction);
    return results;
  }

  void recursive_residuals(std::span<double> recursive) override { read(r_, solved_scale_, 1, recursive); }

  std::vector<double> norm(std::size_t count, std::span<const double> residual) override {
    const std::vector<double> scale = scales(count, residual);
    write(residual, scale, load_);
    std::vector<double> norms = pcg_.preconditioned_norm(multigrid_, count, load_);
    for (std::size_t q = 0; q < count; ++q)
      norms[q] = norms[q] >= 0 ? std::sqrt(norms[q] / tissue_.reference_pa) * scale[q]
                               : std::numeric_limits<double>::infinity();
    return norms;
  }

  std::vector<double> preconditioned(std::size_t count, std::span<const double> residual) override {
    const std::vector<double> scale = scales(count, residual);
    write(residual, scale, load_);
    multigrid_.apply(load_, x_, count);
    std::vector<double> z(residual.size());
    read(x_, scale, 1 / tissue_.reference_pa, z);
    return z;
  }

 private:
  void set_multigrid() {
    if constexpr (std::is_same_v<T, float>)
      if (queue_.supports(Precision::kDouble))
        return multigrid_.set_operator(Elasticity<double>(queue_, tissue_).stencil(), tissue_.free);
    multigrid_.set_operator(operator_.stencil(), tissue_.free);
  }
  // Largest entry of each vector; 1 for a zero vector.
  std::vector<double> scales(std::size_t count, std::span<const double> vectors) const {
    std::vector<double> scale(count, 0);
    const std::size_t dofs = tissue_.grid.dofs();
    for (std::size_t q = 0; q < count; ++q)
      for (const double value : vectors.subspan(q * dofs, dofs))
        scale[q] = std::max(scale[q], std::abs(value));
    for (double& s : scale)
      if (!(s > 0)) s = 1;
    return scale;
  }
  void write(std::span<const double> from, const std::vector<double>& scale, Array<T>& to) {
    const std::size_t dofs = tissue_.grid.dofs();
    host_.resize(scale.size() * dofs);
    for (std::size_t q = 0; q < scale.size(); ++q)
      for (std::size_t n = q * dofs; n < (q + 1) * dofs; ++n) host_[n] = static_cast<T>(from[n] / scale[q]);
    queue_.send(to, host_.data(), host_.size());
  }
  void read(const Array<T>& from, const std::vector<double>& scale, double factor, std::span<double> to) {
    const std::size_t dofs = tissue_.grid.dofs();
    host_.resize(scale.size() * dofs);
    queue_.read(from, host_.data(), host_.size());
    for (std::size_t q = 0; q < scale.size(); ++q)
      for (std::size_t n = q * dofs; n < (q + 1) * dofs; ++n) to[n] = host_[n] * factor * scale[q];
  }

  Queue queue_;
  const ScaledTissue& tissue_;
  Elasticity<T> operator_;
  Multigrid<T, W> multigrid_;
  Pcg<T> pcg_;
  Array<T> r_, load_, x_;  // r_ keeps what the last solve left
  std::vector<double> solved_scale_;
  std::vector<T> host_;
};

}  // namespace

std::unique_ptr<ElasticityCorrection> make_elasticity_correction(Precision precision, const Queue& queue,
                                                                 const ScaledTissue& tissue,
                                                                 std::size_t capacity,
                                                                 const PcgOptions& options) {
  if (precision == Precision::kFloat)
    return std::make_unique<Correction<float, float>>(queue, tissue, capacity, options);
  // Compliances in float take two to three times the iterations near nu = 1/2.
  if (short_side({tissue.grid.x_m, tissue.grid.y_m}) == ShortSide::kNeither)
    return std::make_unique<Correction<double, float>>(queue, tissue, capacity, options);
  return std::make_unique<Correction<double, double>>(queue, tissue, capacity, options);
}

}  // namespace teletact::service
