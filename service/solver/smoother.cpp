#include "service/solver/smoother.h"

#include <utility>

#include "service/solver/convert.h"

namespace teletact::service {
namespace {

template <class T>
class CellSmoother final : public Smoother<T> {
 public:
  CellSmoother(const Queue& queue, Array<T> sum, std::size_t nx, std::size_t ny)
      : sum_(std::move(sum)),
        nx_(nx),
        ny_(ny),
        step_(queue.kernel("multigrid", "cell_step", precision_of<T>)) {}
  void step(const Array<T>& residual, Array<T>& d, Array<T>& z, const ChebyshevStep& c, bool from_zero,
            std::size_t count) override {
    step_(grid_range(nx_, ny_, count), sum_, residual, d, z, static_cast<T>(c.old_direction),
          static_cast<T>(c.new_residual), static_cast<int>(from_zero), static_cast<int>(nx_),
          static_cast<int>(ny_));
  }

 private:
  Array<T> sum_;  // the stencil M
  std::size_t nx_, ny_;
  Kernel step_;
};

template <class T>
class LineSmoother final : public Smoother<T> {
 public:
  LineSmoother(const Queue& queue, Array<T> factor, std::size_t nx, std::size_t ny, bool along_x)
      : queue_(queue), factor_(std::move(factor)), nx_(nx), ny_(ny), along_x_(along_x) {
    solve_ = queue.kernel("lines", "solve_lines", precision_of<T>);
    step_ = queue.kernel("lines", "line_step", precision_of<T>);
  }
  void step(const Array<T>& residual, Array<T>& d, Array<T>& z, const ChebyshevStep& c, bool from_zero,
            std::size_t count) override {
    const std::size_t steps = along_x_ ? nx_ : ny_, lines = (along_x_ ? ny_ : nx_) - 1;
    if (solved_.size() < 4 * steps * lines * count) solved_ = queue_.array<T>(4 * steps * lines * count);
    const int nx = static_cast<int>(nx_), ny = static_cast<int>(ny_), along_x = along_x_;
    solve_({{lines, count}, {8}}, factor_, residual, solved_, nx, ny, along_x);
    step_(grid_range(nx_, ny_, count), solved_, d, z, static_cast<T>(c.old_direction),
          static_cast<T>(c.new_residual), static_cast<int>(from_zero), nx, ny, along_x);
  }

 private:
  Queue queue_;
  Array<T> factor_, solved_;
  std::size_t nx_, ny_;
  bool along_x_;
  Kernel solve_, step_;
};

}  // namespace

template <class T, class S>
std::unique_ptr<Smoother<T>> make_cell_smoother(const Queue& queue, const Array<S>& stencil, std::size_t nx,
                                                std::size_t ny, Array<int>& indefinite) {
  const int columns = static_cast<int>(nx), rows = static_cast<int>(ny);
  auto inverse = queue.array<S>(64 * (nx - 1) * (ny - 1));
  queue.kernel("cells", "invert_cells", precision_of<S>)(grid_range(nx - 1, ny - 1, 1), stencil, inverse,
                                                         indefinite, columns, rows);
  auto sum = queue.array<S>(36 * nx * ny);
  queue.kernel("cells", "gather_cells", precision_of<S>)(grid_range(nx, ny, 1), inverse, sum, columns, rows);
  return std::make_unique<CellSmoother<T>>(queue, converted<T>(queue, sum), nx, ny);
}

template <class T, class S>
std::unique_ptr<Smoother<T>> make_line_smoother(const Queue& queue, const Array<S>& stencil, std::size_t nx,
                                                std::size_t ny, bool along_x, Array<int>& indefinite) {
  const std::size_t steps = along_x ? nx : ny, lines = (along_x ? ny : nx) - 1;
  auto factor = queue.array<S>(32 * steps * lines);
  queue.kernel("lines", "factor_lines", precision_of<S>)({{lines}, {8}}, stencil, factor, indefinite,
                                                         static_cast<int>(nx), static_cast<int>(ny),
                                                         static_cast<int>(along_x));
  return std::make_unique<LineSmoother<T>>(queue, converted<T>(queue, factor), nx, ny, along_x);
}

template std::unique_ptr<Smoother<float>> make_cell_smoother(const Queue&, const Array<float>&, std::size_t,
                                                             std::size_t, Array<int>&);
template std::unique_ptr<Smoother<float>> make_line_smoother(const Queue&, const Array<float>&, std::size_t,
                                                             std::size_t, bool, Array<int>&);
template std::unique_ptr<Smoother<float>> make_cell_smoother(const Queue&, const Array<double>&, std::size_t,
                                                             std::size_t, Array<int>&);
template std::unique_ptr<Smoother<float>> make_line_smoother(const Queue&, const Array<double>&, std::size_t,
                                                             std::size_t, bool, Array<int>&);
template std::unique_ptr<Smoother<double>> make_cell_smoother(const Queue&, const Array<double>&, std::size_t,
                                                              std::size_t, Array<int>&);
template std::unique_ptr<Smoother<double>> make_line_smoother(const Queue&, const Array<double>&, std::size_t,
                                                              std::size_t, bool, Array<int>&);

}  // namespace teletact::service
