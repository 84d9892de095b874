// Pictures of a session: modulus.png (true above estimated), force.png (felt, stated and true along the
// path), latency.png and periods.png (histograms), tactile.png (a film strip). By gnuplot: all throw
// FileError.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client/report/force_error.h"
#include "client/report/inclusions.h"
#include "client/report/session_record.h"

namespace teletact::client {

// True and estimated modulus on the same grid and in the same colours.
void draw_modulus(const std::filesystem::path& file, const Tissue& tissue, const ModulusGrid& estimated);

// The force that was felt over its way along x and over time, with the intervals that were stated for it and
// the true force, where they are known. False, and no file, where nothing was felt.
bool draw_force(const std::filesystem::path& file, const std::vector<ForceSamplePoint>& force);
void draw_latency(const std::filesystem::path& file, const TouchRecord& touch);
void draw_periods(const std::filesystem::path& file, const TouchRecord& touch);

// A film strip of tactile images in contact, at most eight, evenly over the touch: pressure, and below it,
// where that is known, what of it is beyond homogeneous tissue. False, and no file, where no image shows a
// contact.
bool draw_tactile(const std::filesystem::path& file, const TouchRecord& touch);

}  // namespace teletact::client
