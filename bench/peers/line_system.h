// The normal equations of a regularised displacement (T2.3): 2 x 2 blocks on the image's samples, coupled to
// the next sample of the line and to the next line.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace teletact::bench {

// Of the squared differences of the axial and of the lateral displacement, _1 from sample to sample, _2 from
// line to line.
struct RegularisationWeights {
  double axial_1 = 0, axial_2 = 0, lateral_1 = 0, lateral_2 = 0;
};

// Sample k of line l is number k + samples * l; its unknowns, the steps of the axial and the lateral
// displacement, at 2 n and 2 n + 1.
class LineSystem {
 public:
  LineSystem(int samples, int lines, const RegularisationWeights&);
  // (residual - axial_slope da - lateral_slope dl)^2 at sample n.
  void add_datum(std::size_t n, double axial_slope, double lateral_slope, double residual);
  // The regularisation is of displacement + step.
  void add_smoothness_of(const std::vector<double>& axial, const std::vector<double>& lateral);
  // By conjugate gradients to a relative residual of 1e-6, preconditioned by symmetric Gauss-Seidel over
  // lines.
  std::vector<double> solve();

 private:
  using Block = std::array<double, 3>;  // aa, al, ll of a symmetric 2 x 2 matrix
  // couple(n, m, axial weight, lateral weight) for each sample and the next one, and that of the next line.
  template <class Couple>
  void for_neighbours(Couple&&) const;
  void factor();
  std::vector<double> times(const std::vector<double>& x) const;
  void solve_line(int line, double* x) const;  // in place
  std::vector<double> preconditioned(const std::vector<double>& r) const;

  int samples_, lines_;
  RegularisationWeights weights_;
  std::vector<Block> diagonal_, pivots_;  // pivots_: inverses, along each line
  std::vector<double> right_;
};

}  // namespace teletact::bench
