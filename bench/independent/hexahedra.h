// Linear elastic tissue as hexahedra of 20 nodes, written apart from client/patient and the service so that
// it can contradict them (Zienkiewicz and Taylor, The Finite Element Method: serendipity shape functions, 2 x
// 2 x 2 integration points, which do not lock at a Poisson's ratio of 0.49).
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <vector>

namespace teletact::bench {

class Hexahedra {
 public:
  using Point = Eigen::Vector3d;
  static constexpr std::size_t kElementNodes = 20;

  // A box of boxes between the lines, m, ascending, along x, y and z.
  explicit Hexahedra(std::array<std::vector<double>, 3> lines);

  Eigen::Index size() const { return static_cast<Eigen::Index>(nodes_.size()); }
  const Point& node(Eigen::Index n) const { return nodes_[static_cast<std::size_t>(n)]; }

  // Pa, of the eighths of each element that its integration points stand for.
  using Moduli = std::vector<std::array<double, 8>>;
  Moduli means(const std::function<double(const Point&)>& modulus_pa) const;

  struct Solution {
    Eigen::Matrix3Xd displacement_m, force_n;  // of the nodes; forces that hold what is prescribed
  };
  // `prescribed_m`: displacements, 3 x size(), NaN where free. Throws std::runtime_error where it does not
  // converge.
  Solution solve(const Moduli& moduli_pa, double poisson_ratio, const Eigen::Matrix3Xd& prescribed_m) const;

  // By the shape functions of the element that has the point, or is the nearest.
  Point at(const Point& point, const Eigen::Matrix3Xd& of_nodes) const;

 private:
  struct Element {
    Point begin_m, size_m;
    std::array<Eigen::Index, kElementNodes> nodes;
    Eigen::Index dof(Eigen::Index local) const {
      return 3 * nodes[static_cast<std::size_t>(local / 3)] + local % 3;
    }
  };
  std::array<std::vector<double>, 3> lines_;
  std::vector<Point> nodes_;
  std::vector<Element> elements_;  // the last axis fastest
};

// From the first knot to the last, each among them, size_m(position) apart.
std::vector<double> graded_lines(const std::vector<double>& knots,
                                 const std::function<double(double)>& size_m);

}  // namespace teletact::bench
