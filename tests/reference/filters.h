// Medians, smoothing and the reference stress (T3.1) on image grids, in double precision and plain loops:
// what the kernels of displacement.cl and modulus.cl are held against. Node (i, j) has index i + nx j.
#pragma once

#include <cstdint>
#include <vector>

namespace teletact::reference {

struct VectorField {
  int nx = 0, ny = 0;
  std::vector<double> lateral, axial;
};

struct MedianFiltered {
  VectorField field;
  std::vector<double>
      deviation;  // axial distance from the median; 0 where the node stands, infinite without a median
};

// Median of the trusted neighbours' corrections (field - prediction) in place of those further from it than
// the tolerances, and of untrusted ones; the prediction where fewer than three neighbours are trusted.
MedianFiltered median_filter(const VectorField& field, const VectorField& prediction,
                             const std::vector<double>& correlation, int radius, double threshold,
                             double lateral_tolerance, double axial_tolerance);

// Binomial 3 x 3 smoothing by the pairs of opposite neighbours that are both inside the grid.
VectorField smooth(const VectorField&);

// Bilinear value at (column, row), held constant outside.
double bilinear(const std::vector<double>& values, int nx, int ny, double column, double row);

struct ReferenceStressLimits {
  double min_strain = 0, range = 0;
  int first_row = 0;
};

// E = scale * amplitude * stress / eps_yy where it may be said, else NaN (T3.1).
std::vector<double> reference_stress(int nx, const std::vector<double>& axial_strain,
                                     const std::vector<std::uint8_t>& trusted,
                                     const std::vector<double>& stress, double amplitude, double scale,
                                     const ReferenceStressLimits&);

// Median of the values that are not NaN within `radius`, where the node has one itself and at least a third
// of its neighbourhood inside the grid has; else NaN.
std::vector<double> modulus_median(int nx, int ny, const std::vector<double>& modulus, int radius);

}  // namespace teletact::reference
