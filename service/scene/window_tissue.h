// The tissue that a window is touched on (T4): the window with context on each side, on a graded
// grid (base/choices.h). Fine columns lie on one lattice of the whole scene, so that the tissues of two
// windows have the same nodes under a finger that is handed over from one to the other.
#pragma once

#include <memory>
#include <vector>

#include "service/scene/geometry.h"
#include "service/scene/stitched_map.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

struct WindowTissueOptions {
  bool interior_layers = false;  // as in TissueModelOptions
  MemoryAccount account = {};    // the same
};

// Node coordinates of the rows (y), the same for every window of a scene.
std::vector<double> window_rows_m(const SceneGeometry&);
// Node coordinates of the columns (x) for the window [begin, end).
std::vector<double> window_columns_m(const SceneGeometry&, double begin_m, double end_m);

// The tissue model of the window [begin, end): element modulus = harmonic mean over the map's cells (series
// model: exact for layers across the load, and unbiased for strain noise); edges of the grid inside the
// tissue are free, edges on the tissue's border as in the geometry. `before` (may be null): the model of the
// same window over an older map; what has not changed since is taken over.
std::shared_ptr<const TissueModel> build_window_tissue(const SceneGeometry&, const StitchedMap&,
                                                       double begin_m, double end_m,
                                                       const WindowTissueOptions& = {},
                                                       const TissueModel* before = nullptr);

}  // namespace teletact::service
