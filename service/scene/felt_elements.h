// Which elements of an image plane a contact feels, how far across it, and what of the modulus's error is
// left in its force (T9.8).
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::service {

// Of a contact's middle, and its radius, about.
struct FeltPlace {
  double x_m = 0, depth_m = 0, z_m = 0;
  double radius_m = 0;
};

// Shares of a round contact's force that elements between these nodes bear, 1 in all, were the tissue
// homogeneous and its modulus the same all across the plane: in closed form, within a few percent of those of
// finite elements.
class FeltElements {
 public:
  FeltElements(const std::vector<double>& x_m, const std::vector<double>& y_m, const FeltPlace&);
  double z_m() const { return z_m_; }
  double radius_m() const { return radius_m_; }
  // Of what a row of them bears, the share before z (m), and the first moment of that share about the
  // contact's middle, m.
  double before(std::size_t row, double z_m) const;
  double moment_before(std::size_t row, double z_m) const;
  // Of what each row bears, what each of these planes across z (m, in order) tells: between them it is
  // interpolated, beyond them constant. [plane][row]
  std::vector<std::vector<double>> told_by(const std::vector<double>& planes_m) const;
  // f(element, share) of those with any.
  template <class F>
  void each(const F& f) const {
    each_row([&](std::size_t first, const double* share, std::size_t columns) {
      for (std::size_t n = 0; n < columns; ++n)
        if (share[n] > 0) f(first + n, share[n]);
    });
  }
  // f(its first element, their shares, how many), whatever they bear.
  template <class F>
  void each_row(const F& f) const {
    for (std::size_t row = 0; row < scale_.size(); ++row)
      f(first_ + all_columns_ * row, share_.data() + columns_ * row, columns_);
  }

 private:
  double across(std::size_t row, double z_m) const;
  std::size_t all_columns_, first_, columns_;
  double z_m_, radius_m_;
  std::vector<double> share_, scale_;  // of elements; of rows, 1 / m
};

// Variance of the mean with these shares, over the mean of the variances, of what correlates by
// exp(-distance / length).
double left_of_local(double radius_m, double length_m);

}  // namespace teletact::service
