// Displacement trackers of others, each from its publication, in double precision on one thread of the host;
// and what they share with ours: the same image grid, search range and windows.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::bench {

// Nodes i + nx j of the image grid.
struct Track {
  service::ImageGrid grid;
  std::vector<double> axial_m;
  std::vector<double> lateral_m;  // empty: the method does not say
  std::vector<double> std_m;      // of axial_m; empty: the method does not say
  std::vector<double> correlation;
  std::vector<std::uint8_t> valid;  // correlation above TrackerOptions::min_correlation
};

// The product's defaults, for all.
struct TrackerOptions {
  double max_strain = service::DisplacementOptions{}.max_strain;  // the axial search: max_strain * depth
  double lateral_search_m = service::kLateralSearchM;
  double grid_dx_m = service::kGridDxM;
  double grid_dy_m = service::kGridDyM;
  double window_axial_m = service::kFineWindowAxialM;
  double window_lateral_m = service::kFineWindowLateralM;
  double min_correlation = service::kTrustedCorrelation;
};

struct Tracker {
  std::string name;
  std::function<Track(const service::RfFrame& pre, const service::RfFrame& post,
                      const service::AcquisitionGeometry&)>
      track;
  bool ours = false;
};

// Normalised cross-correlation over the whole search range, parabolic peak (T2.1); sums shared between
// windows as by Luo & Konofagou 2010, doi 10.1109/TUFFC.2010.1554.
Tracker make_ncc_tracker(TrackerOptions = {});
// Multi-level block matching, Shi & Varghese 2007, doi 10.1088/0031-9155/52/2/006: envelope first, RF in the
// end.
Tracker make_block_matcher(TrackerOptions = {});
// Dynamic programming (Rivaz et al. 2008, doi 10.1109/TMI.2008.917243), then GLUE (Hashemi & Rivaz 2017,
// doi 10.1109/TUFFC.2017.2717933): one regularised system over all samples of the image.
Tracker make_glue_tracker(TrackerOptions = {});
// Phase of the 2-D autocorrelation (Loupas et al. 1995, doi 10.1109/58.393110), followed down each line from
// the probe's face (Pesavento et al. 1999, doi 10.1109/58.796111).
Tracker make_loupas_tracker(TrackerOptions = {});

}  // namespace teletact::bench
