// Axial strain in the cells of a probed tissue as it was measured, as it is modelled, and what homogeneous
// tissue does not have of it (T3.6).
#pragma once

#include <Eigen/Core>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

// ln of the strain's size in each cell; what it is off by, as a part of it; observed: 1 where it was
// measured.
struct CellStrains {
  Eigen::VectorXd log_strain, deviation, observed;
};

// `top_m`: depth of the face in the image; `sign` of the strain that counts, -1 compression.
CellStrains cell_strains(const Measured&, const CellGrid&, double top_m, double sign);

// The depth at which the tissue begins, where what the image shows above it was not tracked. Throws
// NoCompression.
double top_of(const Measured&);

// The depth to which it is shown: below it nothing is tracked over half of the width.
double bottom_of(const Measured&);

// Sets observed to 0 in cells that tell no modulus: near the face, within `edge_m` of a pad's end, and where
// homogeneous tissue hardly strains. Throws NoCompression where none is left.
void leave_out(const Eigen::VectorXd& log_strain, const CellGrid&, double pad_m, double edge_m,
               Eigen::VectorXd& observed);

// Median over the cells that are observed.
double level_of(const Eigen::VectorXd& of_cells, const Eigen::VectorXd& observed);

// A field of the cells as the least-squares kernel of the strain sees it; at the ends it is cut.
Eigen::VectorXd as_measured(const Eigen::VectorXd& strain, const CellGrid&, const StrainOptions&);

// Values of the cells at node n of the image, bilinear; beyond the cells those of the nearest.
double at_node(const Eigen::VectorXd& of_cells, const CellGrid&, const ImageGrid&, double top_m,
               std::size_t n);

// Over what area a field of the cells is alike, m2: the integral of its autocorrelation while that is above
// 0, lumps limited to two scales.
double alike_m2(const Eigen::VectorXd& of_cells, const CellGrid&, double scale);

// Takes off some of what each column differs by from all, after a step: columns of a block pressed evenly, or
// of tissue that slides, strain alike, whatever their moduli, so that what the strain's columns differ by
// would add up step by step. No more of it than that: what a step brings over it is no such difference, but a
// face that touches in part.
void hold_columns(Eigen::VectorXd& log_modulus, const CellGrid&);

}  // namespace teletact::service
