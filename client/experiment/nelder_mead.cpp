#include "client/experiment/nelder_mead.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace teletact::client {
namespace {

constexpr double kReflect = 1, kExpand = 2, kContract = 0.5, kShrink = 0.5;

struct Vertex {
  Parameters at{};
  double value = 0;
};

class Simplex {
 public:
  Simplex(const std::function<double(const Parameters&)>& cost, const Parameters& start, std::size_t n,
          double step)
      : cost_(cost), n_(n) {
    for (std::size_t k = 0; k <= n_; ++k) {
      vertices_[k].at = start;
      if (k > 0) vertices_[k].at[k - 1] += step;
      vertices_[k].value = value(vertices_[k].at);
    }
    sort();
  }

  const Vertex& best() const { return vertices_[0]; }
  unsigned evaluations() const { return evaluations_; }

  double width() const {
    double widest = 0;
    for (std::size_t k = 1; k <= n_; ++k)
      for (std::size_t d = 0; d < n_; ++d)
        widest = std::max(widest, std::abs(vertices_[k].at[d] - vertices_[0].at[d]));
    return widest;
  }

  // Replaces the worst vertex, or shrinks towards the best.
  void step() {
    Vertex& worst = vertices_[n_];
    const Vertex reflected = beyond_centre(kReflect);
    if (reflected.value < vertices_[0].value) {
      const Vertex expanded = beyond_centre(kExpand);
      worst = expanded.value < reflected.value ? expanded : reflected;
    } else if (reflected.value < vertices_[n_ - 1].value) {
      worst = reflected;
    } else {
      const bool outside = reflected.value < worst.value;
      const Vertex contracted = beyond_centre(outside ? kContract : -kContract);
      if (contracted.value < std::min(reflected.value, worst.value))
        worst = contracted;
      else
        shrink();
    }
    sort();
  }

 private:
  // Undefined is worse than anything, NaN included.
  double value(const Parameters& at) {
    ++evaluations_;
    const double v = cost_(at);
    return std::isnan(v) ? std::numeric_limits<double>::infinity() : v;
  }

  // centre + factor (centre - worst), centre of all but the worst.
  Vertex beyond_centre(double factor) {
    Vertex vertex;
    for (std::size_t d = 0; d < n_; ++d) {
      double centre = 0;
      for (std::size_t k = 0; k < n_; ++k) centre += vertices_[k].at[d];
      centre /= static_cast<double>(n_);
      vertex.at[d] = centre + factor * (centre - vertices_[n_].at[d]);
    }
    vertex.value = value(vertex.at);
    return vertex;
  }

  void shrink() {
    for (std::size_t k = 1; k <= n_; ++k) {
      for (std::size_t d = 0; d < n_; ++d)
        vertices_[k].at[d] = vertices_[0].at[d] + kShrink * (vertices_[k].at[d] - vertices_[0].at[d]);
      vertices_[k].value = value(vertices_[k].at);
    }
  }

  void sort() {
    std::stable_sort(vertices_.begin(), vertices_.begin() + static_cast<std::ptrdiff_t>(n_) + 1,
                     [](const Vertex& a, const Vertex& b) { return a.value < b.value; });
  }

  const std::function<double(const Parameters&)>& cost_;
  std::size_t n_;
  unsigned evaluations_ = 0;
  std::array<Vertex, kParametersMax + 1> vertices_{};
};

}  // namespace

NelderMeadResult nelder_mead(const std::function<double(const Parameters&)>& cost, const Parameters& start,
                             std::size_t dimensions, const NelderMeadOptions& options) {
  if (dimensions < 1 || dimensions > kParametersMax)
    throw std::invalid_argument("dimensions: 1 to " + std::to_string(kParametersMax));
  Simplex simplex(cost, start, dimensions, options.first_step);
  if (!std::isfinite(simplex.best().value))
    throw std::invalid_argument("start: the cost is not finite there");
  while (simplex.width() > options.tolerance && simplex.evaluations() < options.evaluations) simplex.step();
  return {simplex.best().at, simplex.best().value, simplex.evaluations(),
          simplex.width() <= options.tolerance};
}

}  // namespace teletact::client
