#include "service/tissue/elasticity_correction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "service/solver/multigrid.h"
#include "service/tissue/block_tridiagonal.h"

namespace teletact::service {
namespace {

// Conjugate gradients by multigrid; T: of vectors and operator, W: of multigrid.
template <class T, class W>
class MultigridPcg {
 public:
  MultigridPcg(const Queue& queue, const ScaledTissue& tissue, const PcgOptions& options)
      : queue_(queue),
        options_(options),
        dofs_(tissue.grid.dofs()),
        operator_(queue, tissue),
        multigrid_(queue, {tissue.grid.x_m, tissue.grid.y_m}) {
    if (queue.supports(Precision::kDouble))
      multigrid_.set_operator(Elasticity<double>(queue, tissue).stencil(), tissue.free);
    else
      multigrid_.set_operator(operator_.stencil(), tissue.free);
  }
  void reserve(std::size_t count) { pcg_ = Pcg<T>(queue_, dofs_, count, options_); }
  std::vector<PcgResult> solve(std::size_t count, Array<T>& r, const Array<T>& load, Array<T>& x,
                               const std::vector<double>& initial_energy,
                               const std::vector<double>& absolute_error) {
    return pcg_->solve(operator_, multigrid_, count, r, load, x, initial_energy, absolute_error);
  }
  std::vector<double> apply(std::size_t count, const Array<T>& r, Array<T>& z) {
    return pcg_->preconditioned_norm(multigrid_, count, r, z);
  }
  void set_relative_error(double error) { pcg_->options().relative_error = error; }

 private:
  Queue queue_;
  PcgOptions options_;
  std::size_t dofs_;
  Elasticity<T> operator_;
  Multigrid<T, W> multigrid_;
  std::optional<Pcg<T>> pcg_;
};

// T: of the vectors of Method.
template <class T, class Method>
class Correction : public ElasticityCorrection {
 public:
  Correction(const Queue& queue, const ScaledTissue& tissue, const PcgOptions& options)
      : queue_(queue), tissue_(tissue), method_(queue, tissue, options) {}

  void reserve(std::size_t count) override {
    const auto room = [&] { return queue_.array<T>(count * tissue_.grid.dofs()); };
    Array<T> r = room(), load = room(), x = room();
    method_.reserve(count);
    r_ = std::move(r), load_ = std::move(load), x_ = std::move(x);
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
    method_.set_relative_error(problem.relative_error);
    std::vector<PcgResult> results = method_.solve(problem.count, r_, load_, x_, energy, error);
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
    std::vector<double> norms = method_.apply(count, load_, x_);
    for (std::size_t q = 0; q < count; ++q)
      norms[q] = norms[q] >= 0 ? std::sqrt(norms[q] / tissue_.reference_pa) * scale[q]
                               : std::numeric_limits<double>::infinity();
    return norms;
  }

  std::vector<double> preconditioned(std::size_t count, std::span<const double> residual) override {
    const std::vector<double> scale = scales(count, residual);
    write(residual, scale, load_);
    method_.apply(count, load_, x_);
    std::vector<double> z(residual.size());
    read(x_, scale, 1 / tissue_.reference_pa, z);
    return z;
  }

 private:
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
  Method method_;
  Array<T> r_, load_, x_;  // r_ keeps what the last solve left
  std::vector<double> solved_scale_;
  std::vector<T> host_;
};

}  // namespace

std::unique_ptr<ElasticityCorrection> make_elasticity_correction(Precision precision, const Queue& queue,
                                                                 const ScaledTissue& tissue,
                                                                 const PcgOptions& options) {
  const auto make = [&]<class T, class Method>() -> std::unique_ptr<ElasticityCorrection> {
    return std::make_unique<Correction<T, Method>>(queue, tissue, options);
  };
  const bool in_float = precision == Precision::kFloat;
  if (is_narrow(queue.info(), tissue.grid))
    return in_float ? make.operator()<float, BlockTridiagonalPcg<float>>()
                    : make.operator()<double, BlockTridiagonalPcg<double>>();
  if (in_float) return make.operator()<float, MultigridPcg<float, float>>();
  // Compliances in float take two to three times the iterations near nu = 1/2.
  if (short_side({tissue.grid.x_m, tissue.grid.y_m}) == ShortSide::kNeither)
    return make.operator()<double, MultigridPcg<double, float>>();
  return make.operator()<double, MultigridPcg<double, double>>();
}

}  // namespace teletact::service
