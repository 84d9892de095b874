// The service's maps on disk: VTI for ParaView, PNG to look at, NetCDF with units, estimate.json with the
// figures.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "client/acquire/estimate_client.h"
#include "client/files/file_io.h"

namespace teletact::client {

// The values of a map as float, x fastest, whatever type they travelled in. Throws std::runtime_error when
// the array does not fill its grid.
std::vector<float> values_of(const teletact::v1::Map& map);

// The map of that name. Throws ServiceError (INTERNAL) where the service sent none.
const teletact::v1::Map& map_of(const std::vector<teletact::v1::Map>& maps, std::string_view name);

// What the maps were made of, and by whom.
struct EstimateSource {
  std::string pre, post;  // files
  std::string made;       // FramePair::made
  teletact::v1::GetInfoResponse info;
};

// Writes displacement, strain, correlation and modulus as .vti and .png (nodes that are not valid are grey in
// the pictures and keep their value in the files, beside the array `valid`), all maps as maps.nc (where this
// client can write it; NaN where not valid, names as in the Python client), and estimate.json, which also
// says which tissue was assumed. It is written last: where it is, all are of this estimate. Returns the names
// of the files written. Throws FileError.
std::vector<std::string> write_estimate(const std::filesystem::path& folder,
                                        const teletact::v1::Acquisition& acquisition,
                                        const EstimateOutcome& outcome, const EstimateSource& source);

}  // namespace teletact::client
