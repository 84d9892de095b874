// What a force may be off by, term by term (T9.4).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

namespace teletact::service {

enum class ErrorTerm : std::uint8_t {
  kSolver,        // the equations on these nodes, and layers that have drifted from those solved with
  kMesh,          // nodes so far apart
  kFiniteStrain,  // a linear model of what is pressed so deep
  kModulus,       // Young's modulus of what is felt, and what that rests on, where it was measured
  kModel,         // what a cheaper model than the solid leaves out of the tissue (T9.5)
  kDimension,     // a plane that stands for a solid (T9.7)
  kContext,       // tissue beside what was given (T9.6)
  kSlices         // tissue between a solid's slices (T8.7)
};
enum class TermKind : std::uint8_t {
  kBound,     // it is not off by more
  kEstimate,  // within twice this in 95 of 100
  kDeviation  // standard deviation
};

struct ForceError {
  ErrorTerm term = ErrorTerm::kSolver;
  TermKind kind = TermKind::kBound;
  double relative = 0;  // over the force, >= 0
  bool operator==(const ForceError&) const = default;
};

// Terms are taken for independent: deviations and estimates add as squares, bounds on top of that.
class ForceBudget {
 public:
  static constexpr std::size_t kMaxTerms = 8;  // each once
  static constexpr double kOf95 = 1.96;        // half of the interval over a deviation or an estimate
  // What the interval reaches further up than down, over the force: where tissue stiffens with strain.
  double above = 0;
  void add(const ForceError& error) {
    if (count_ < kMaxTerms) terms_[count_++] = error;
  }
  std::span<const ForceError> terms() const { return {terms_.data(), count_}; }
  // Half of the interval that holds the true force in 95 of 100, over the force; 0 where nothing is stated.
  double half_width() const {
    return half_width([](const ForceError&) { return true; });
  }
  // The same but for the modulus: what another model may make less.
  double of_model() const {
    return half_width(
        [](const ForceError& e) { return e.term != ErrorTerm::kModulus && e.term != ErrorTerm::kSlices; });
  }
  double relative(ErrorTerm term) const {
    const auto all = terms();
    const auto found = std::ranges::find(all, term, &ForceError::term);
    return found == all.end() ? 0 : found->relative;
  }
  bool operator==(const ForceBudget&) const = default;

 private:
  template <class Counts>
  double half_width(const Counts& counts) const {
    double bounds = 0, squares = 0;
    for (const ForceError& e : terms()) {
      if (!counts(e)) continue;
      (e.kind == TermKind::kBound ? bounds : squares) +=
          e.kind == TermKind::kBound ? e.relative : e.relative * e.relative;
    }
    return bounds + kOf95 * std::sqrt(squares);
  }
  std::array<ForceError, kMaxTerms> terms_{};
  std::size_t count_ = 0;
};

// What a model may put a force off by, the larger of a share of it and newtons. As it is here where nobody
// asks for one.
struct Tolerance {
  double relative = 0.03, force_n = 0.005;
  double of_n(double force) const { return std::max(relative * force, force_n); }
  bool allows(const ForceBudget& budget, double force) const {
    return budget.of_model() * force <= of_n(force);
  }
  bool operator==(const Tolerance&) const = default;
};
// Of whom asks for none: half of what the modulus is known to is enough, up to a tenth. deviation: of ln E,
// the least in the tissue that is meant; 0: not known.
inline Tolerance usual_tolerance(double deviation) {
  constexpr double kMax = 0.1;  // a lump that changes the force by more is felt
  Tolerance usual;
  usual.relative = std::clamp(deviation / 2, usual.relative, kMax);
  return usual;
}

}  // namespace teletact::service
