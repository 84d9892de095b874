#include "service/solver/smoother.h"

#include <string>

namespace teletact::service {

template <class S, class W>
void cell_smoother(const Queue& queue, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                   Array<int>& indefinite, Array<W>& planes, int at, int stride) {
  const int columns = static_cast<int>(nx), rows = static_cast<int>(ny);
  const std::size_t width = queue.info().width<S>(), items = (nx - 1 + width - 1) / width;
  Defines defines = planes_of<W>();
  defines["WIDTH"] = std::to_string(width);
  const auto kernel = [&](const char* name) { return queue.kernel("cells", name, precision_of<S>, defines); };
  auto inverse = queue.array<S>(36 * width * items * (ny - 1));
  kernel("invert_cells")(grid_range(items, ny - 1, 1), stencil, inverse, indefinite, columns, rows);
  kernel("gather_cells")({{static_cast<std::size_t>(stride)}, {64}}, inverse, planes, at, stride, columns,
                         rows);
}

template <class S>
Array<S> line_factor(const Queue& queue, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                     bool along_x, Array<int>& indefinite) {
  const std::size_t steps = along_x ? nx : ny, lines = (along_x ? ny : nx) - 1;
  auto factor = queue.array<S>(32 * steps * lines);
  queue.kernel("lines", "factor_lines", precision_of<S>)({{lines}, {8}}, stencil, factor, indefinite,
                                                         static_cast<int>(nx), static_cast<int>(ny),
                                                         static_cast<int>(along_x));
  return factor;
}

template void cell_smoother(const Queue&, const Array<float>&, std::size_t, std::size_t, Array<int>&,
                            Array<float>&, int, int);
template void cell_smoother(const Queue&, const Array<double>&, std::size_t, std::size_t, Array<int>&,
                            Array<float>&, int, int);
template void cell_smoother(const Queue&, const Array<double>&, std::size_t, std::size_t, Array<int>&,
                            Array<double>&, int, int);
template Array<float> line_factor(const Queue&, const Array<float>&, std::size_t, std::size_t, bool,
                                  Array<int>&);
template Array<double> line_factor(const Queue&, const Array<double>&, std::size_t, std::size_t, bool,
                                   Array<int>&);

}  // namespace teletact::service
