#include "service/solver/pcg.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>

namespace teletact::service {
namespace {

// Fields of the scalars that are read alone, as in kernels/pcg.clh.
enum Field : std::size_t { kDecrease = 3, kRr = 5, kEstimate = 6, kScale = 7 };
enum History : std::size_t { kAlphaOf = 1, kBetaOf = 2 };

// Nodes that one work item sums, and the most partial sums of one right-hand side.
constexpr std::size_t kSmallestChunk = 32, kMaxChunks = 1024;

constexpr std::size_t kLocal = 64;  // work-group size over nodes, and that sums up chunks on a GPU

// Whether the tridiagonal matrix less `shift` is positive definite: all pivots of its LDL^T are positive.
bool positive_definite(const std::vector<double>& diagonal, const std::vector<double>& squared_off,
                       double shift) {
  double pivot = 1;
  for (std::size_t k = 0; k < diagonal.size(); ++k) {
    pivot = diagonal[k] - shift - (k ? squared_off[k - 1] / pivot : 0);
    if (!(pivot > 0)) return false;
  }
  return true;
}

}  // namespace

const char* to_string(StopReason reason) {
  switch (reason) {
    case StopReason::kRunning:
      return "running";
    case StopReason::kConverged:
      return "converged";
    case StopReason::kIterationLimit:
      return "iteration limit";
    case StopReason::kIndefinite:
      return "not positive definite";
    case StopReason::kNotFinite:
      return "not finite";
  }
  return "unknown";
}

double smallest_ritz_value(const Lanczos& lanczos) {
  std::vector<double> diagonal, squared_off;
  double highest = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < lanczos.alpha.size(); ++k) {
    if (!(lanczos.alpha[k] > 0)) break;  // the step that stopped it
    diagonal.push_back(1 / lanczos.alpha[k] + (k ? lanczos.beta[k - 1] / lanczos.alpha[k - 1] : 0));
    squared_off.push_back(lanczos.beta[k] / (lanczos.alpha[k] * lanczos.alpha[k]));
    highest = std::min(highest, diagonal.back());
  }
  if (diagonal.empty()) return 0;
  double lowest = 0;
  for (int step = 0; step < 40; ++step) {
    const double middle = (lowest + highest) / 2;
    (positive_definite(diagonal, squared_off, middle) ? lowest : highest) = middle;
  }
  return highest;
}

template <class T>
Pcg<T>::Pcg(const Queue& queue, std::size_t unknowns, std::size_t count, const PcgOptions& options)
    : queue_(queue), options_(options), nodes_(unknowns / 2), capacity_(count) {
  if (options.max_iterations == 0)
    throw std::invalid_argument("PcgOptions: max_iterations must be at least 1");
  chunk_ = std::max(kSmallestChunk, (nodes_ + kMaxChunks - 1) / kMaxChunks);
  chunks_ = (nodes_ + chunk_ - 1) / chunk_;
  group_ = queue.info().gpu ? kLocal : 1;
  const Defines defines{{"GROUP", std::to_string(group_)}};
  const auto get = [&](const char* name) { return queue.kernel("pcg", name, precision_of<T>, defines); };
  dot_ = get("dot_two");
  begin_ = get("pcg_begin");
  alpha_ = get("pcg_alpha");
  update_ = get("pcg_update");
  judge_ = get("pcg_judge");
  beta_ = get("pcg_beta");
  direction_ = get("pcg_direction");
  for (Array<T>* a : {&z_, &p_, &ap_}) *a = queue.array<T>(unknowns * count);
  partial_ = queue.array<T>(2 * chunks_ * count);
}

// A work-group for each right-hand side, which adds up its partial sums.
template <class T>
Range Pcg<T>::over_each(std::size_t count) const {
  return {{group_ * count},
          {group_},
          group_ > 1 ? chunks_ / (2 * group_) + std::bit_width(group_) : chunks_ / 16 + 20};
}

// Partial sums of a.b and c.d.
template <class T>
void Pcg<T>::dot_two(const Array<T>& a, const Array<T>& b, const Array<T>& c, const Array<T>& d,
                     std::size_t count) {
  dot_({{chunks_, count}, {local_of_chunks()}, chunk_}, a, b, c, d, partial_, static_cast<int>(nodes_),
       static_cast<int>(chunk_), static_cast<int>(chunks_), static_cast<int>(count));
}

template <class T>
void Pcg<T>::begin(LinearOperator<T>& preconditioner, std::size_t count, Array<T>& r, Array<T>& x,
                   const std::vector<double>& initial_energy, const std::vector<double>& absolute_error) {
  if (const std::size_t size = (kPcgFields + kPcgHistory * options_.max_iterations) * capacity_;
      scalars_.size() < size)
    scalars_ = queue_.array<T>(size);
  queue_.send(scalars_, pcg_scalars<T>(count, initial_energy, absolute_error));
  queue_.fill_zero(x);
  preconditioner.apply(r, z_, count);
  dot_two(r, z_, r, r, count);
  begin_(over_each(count), partial_, scalars_, static_cast<int>(chunks_), static_cast<int>(count));
  direction_({{nodes_, count}, {kLocal}}, scalars_, z_, p_, static_cast<int>(nodes_),
             static_cast<int>(count));
}

template <class T>
void Pcg<T>::advance(LinearOperator<T>& a, std::size_t iteration, std::size_t count, Array<T>& r,
                     const Array<T>& load, Array<T>& x) {
  const Range each = over_each(count), all{{chunks_, count}, {local_of_chunks()}, chunk_};
  const int k = static_cast<int>(iteration), rhs = static_cast<int>(count);
  const int nodes = static_cast<int>(nodes_), chunk = static_cast<int>(chunk_);
  const int chunks = static_cast<int>(chunks_);
  // alpha = r.z / p.Ap
  a.apply(p_, ap_, count);
  dot_two(p_, ap_, p_, load, count);
  alpha_(each, partial_, scalars_, k, chunks, rhs);
  // x += alpha p, r -= alpha A p
  update_(all, scalars_, p_, ap_, x, r, partial_, nodes, chunk, chunks, rhs);
  judge_(each, partial_, scalars_, k, static_cast<int>(kDelay),
         static_cast<T>(options_.relative_error * options_.relative_error),
         static_cast<T>(options_.relative_residual * options_.relative_residual), chunks, rhs);
}

template <class T>
void Pcg<T>::turn(LinearOperator<T>& preconditioner, std::size_t iteration, std::size_t count,
                  const Array<T>& r) {
  const int rhs = static_cast<int>(count);
  // z = M r
  preconditioner.apply(r, z_, count);
  // beta = (r.z)_new / (r.z)_old
  dot_two(r, z_, r, r, count);
  beta_(over_each(count), partial_, scalars_, static_cast<int>(iteration), static_cast<int>(chunks_), rhs);
  // p = z + beta p
  direction_({{nodes_, count}, {kLocal}}, scalars_, z_, p_, static_cast<int>(nodes_), rhs);
}

template <class T>
std::vector<PcgResult> Pcg<T>::solve(LinearOperator<T>& a, LinearOperator<T>& preconditioner,
                                     std::size_t count, Array<T>& r, const Array<T>& load, Array<T>& x,
                                     const std::vector<double>& initial_energy,
                                     const std::vector<double>& absolute_error) {
  if (count == 0) return {};
  if (count > capacity_) throw std::invalid_argument("Pcg: more right-hand sides than it was made for");
  begin(preconditioner, count, r, x, initial_energy, absolute_error);
  for (std::size_t k = 0;; ++k) {
    advance(a, k, count, r, load, x);
    const std::size_t done = k + 1;
    const bool last = done >= options_.max_iterations;
    if (last || done >= 2 * kDelay) {
      std::vector<T> scalars((kPcgFields + kPcgHistory * done) * count);
      queue_.read(scalars_, scalars.data(), scalars.size());
      const std::span<const T> states = std::span(scalars).subspan(kPcgState * count, count);
      if (last || std::ranges::find(states, static_cast<T>(StopReason::kRunning)) == states.end())
        return pcg_results(scalars, count);
    }
    turn(preconditioner, k, count, r);
  }
}

template <class T>
std::vector<T> pcg_scalars(std::size_t count, const std::vector<double>& initial_energy,
                           const std::vector<double>& absolute_error) {
  std::vector<T> scalars(kPcgFields * count, T{0});
  for (std::size_t q = 0; q < count; ++q) {
    if (!initial_energy.empty()) scalars[kPcgInitial * count + q] = static_cast<T>(initial_energy[q]);
    if (!absolute_error.empty())
      scalars[kPcgAbsolute * count + q] = static_cast<T>(absolute_error[q] * absolute_error[q]);
  }
  return scalars;
}

template <class T>
std::vector<PcgResult> pcg_results(const std::vector<T>& scalars, std::size_t count) {
  std::vector<PcgResult> results(count);
  for (std::size_t q = 0; q < count; ++q) {
    PcgResult& result = results[q];
    const auto field = [&](std::size_t f) { return static_cast<double>(scalars[f * count + q]); };
    result.reason = static_cast<StopReason>(static_cast<int>(field(kPcgState)));
    if (result.reason == StopReason::kRunning) result.reason = StopReason::kIterationLimit;
    result.iterations = static_cast<std::size_t>(field(kPcgIterations));
    result.recursive_residual = std::sqrt(field(kRr));
    result.squared_error = field(kEstimate);
    result.squared_energy = field(kScale);
    result.squared_decrease = field(kDecrease);
    Lanczos lanczos;
    for (std::size_t k = 0; k < result.iterations; ++k) {
      lanczos.alpha.push_back(field(kPcgFields + kPcgHistory * k + kAlphaOf));
      lanczos.beta.push_back(field(kPcgFields + kPcgHistory * k + kBetaOf));
    }
    result.smallest_eigenvalue = smallest_ritz_value(lanczos);
  }
  return results;
}

template <class T>
std::vector<double> Pcg<T>::preconditioned_norm(LinearOperator<T>& preconditioner, std::size_t count,
                                                const Array<T>& r, Array<T>& z) {
  preconditioner.apply(r, z, count);
  dot_two(r, z, r, r, count);
  std::vector<T> partial(chunks_ * count);
  queue_.read(partial_, partial.data(), partial.size());
  std::vector<double> norms(count);
  for (std::size_t q = 0; q < count; ++q)
    for (std::size_t n = 0; n < chunks_; ++n) norms[q] += static_cast<double>(partial[q * chunks_ + n]);
  return norms;
}

template std::vector<float> pcg_scalars(std::size_t, const std::vector<double>&, const std::vector<double>&);
template std::vector<double> pcg_scalars(std::size_t, const std::vector<double>&, const std::vector<double>&);
template std::vector<PcgResult> pcg_results(const std::vector<float>&, std::size_t);
template std::vector<PcgResult> pcg_results(const std::vector<double>&, std::size_t);
template class Pcg<float>;
template class Pcg<double>;

}  // namespace teletact::service
