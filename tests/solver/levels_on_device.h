// Two of multigrid's levels on the device, laid out as the product does and filled by hand.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "service/solver/level_layout.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {

template <class W>
class LevelsOnDevice {
 public:
  // width: nodes of a work item; count: vectors; coefficients: what the constants begin with.
  LevelsOnDevice(const Queue& queue, const GridTransfer& transfer, std::size_t width, std::size_t count,
                 const std::vector<W>& coefficients = {})
      : layout(lay_out({fine_lines(transfer), {transfer.x.coarse, transfer.y.coarse}}, {transfer}, width,
                       coefficients.size())),
        table(queue.array(layout.table)),
        constants(queue.array(std::vector<W>(static_cast<std::size_t>(layout.constants_size)))),
        vectors(queue.array(std::vector<W>(count * static_cast<std::size_t>(layout.vectors_size)))),
        queue_(queue),
        width_(width),
        count_(count) {
    write(coefficients, 0);
    write({transfer.x.around.begin(), transfer.x.around.end()}, fine().around_x);
    write({transfer.y.around.begin(), transfer.y.around.end()}, fine().around_y);
  }
  const LevelLayout& fine() const { return layout.levels[0]; }
  std::size_t count() const { return count_; }
  Kernel kernel(const char* program, const char* name) const {
    return queue_.kernel(program, name, precision_of<W>,
                         {{"WIDTH", std::to_string(width_)}, {"GROUP", "64"}});
  }
  Range items(const LevelLayout& level) const {
    return {{(static_cast<std::size_t>(level.span()) + width_ - 1) / width_, count_}, {8}};
  }
  // Vectors of a level, at one of LevelLayout's places, rubbish between them excluded.
  void set(const LevelLayout& level, int at, const Eigen::MatrixXd& v) {
    std::vector<W> host = queue_.read(vectors);
    each(level, at,
         [&](Eigen::Index n, Eigen::Index q, std::size_t place) { host[place] = static_cast<W>(v(n, q)); });
    queue_.write(vectors, host.data(), host.size());
  }
  Eigen::MatrixXd get(const LevelLayout& level, int at) const {
    const std::vector<W> host = queue_.read(vectors);
    Eigen::MatrixXd v(2 * level.nx * level.ny, static_cast<Eigen::Index>(count_));
    each(level, at, [&](Eigen::Index n, Eigen::Index q, std::size_t place) { v(n, q) = host[place]; });
    return v;
  }
  // A symmetric stencil's planes.
  void set_stencil(const LevelLayout& level, int at, const Array<W>& stencil) {
    queue_.kernel("planes", "stencil_to_planes", precision_of<W>)(
        {{static_cast<std::size_t>(level.stride)}, {64}}, stencil, constants, at, level.stride, level.nx,
        level.ny);
  }
  void set_free(const LevelLayout& level, const std::vector<std::uint8_t>& free) {
    for (std::size_t n = 0; n < free.size(); ++n)
      write({static_cast<W>(free[n])}, static_cast<int>(place(level, level.free, n)));
  }

  HierarchyLayout layout;
  Array<int> table;
  Array<W> constants, vectors;

 private:
  // As many as there are: their coordinates do not matter to a layout.
  static NodeLines fine_lines(const GridTransfer& t) {
    return {std::vector<double>(t.x.left.size()), std::vector<double>(t.y.left.size())};
  }
  void write(const std::vector<W>& values, int at) {
    queue_.write(constants, values.data(), values.size(), static_cast<std::size_t>(at));
  }
  // Of unknown n of a level in a pair of planes.
  static std::size_t place(const LevelLayout& level, int at, std::size_t n) {
    const int node = static_cast<int>(n / 2), component = static_cast<int>(n % 2);
    return static_cast<std::size_t>(at + component * level.stride + level.first() + node % level.nx +
                                    level.pitch * (node / level.nx));
  }
  void each(const LevelLayout& level, int at, auto&& visit) const {
    for (std::size_t q = 0; q < count_; ++q)
      for (std::size_t n = 0; n < static_cast<std::size_t>(2 * level.nx * level.ny); ++n)
        visit(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(q),
              q * static_cast<std::size_t>(layout.vectors_size) + place(level, at, n));
  }
  Queue queue_;
  std::size_t width_, count_;
};

}  // namespace teletact::service
