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
  // f(element, share) of those with any.
  template <class F>
  void each(const F& f) const {
    for (std::size_t n = 0; n < share_.size(); ++n)
      if (share_[n] > 0) f(first_ + n % columns_ + all_columns_ * (n / columns_), share_[n]);
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
