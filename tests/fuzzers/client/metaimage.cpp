// RF frames and maps: files of MetaImage.
#include "client/files/metaimage.h"

#include <algorithm>
#include <cmath>

#include "tests/fuzzers/client/fuzzers.h"

namespace teletact::fuzzers {
namespace {

using client::MetaImage;

void check(const MetaImage& image) {
  const std::size_t dimensions = image.size.size();
  require(dimensions == 2 || dimensions == 3, "neither 2 nor 3 dimensions");
  require(image.data.size() == image.values() * client::element_bytes(image.type),
          "data that do not fill the size");
  require(!image.data.empty(), "no data");
  require(image.spacing.empty() || image.spacing.size() == dimensions, "a spacing of other dimensions");
  require(image.origin.empty() || image.origin.size() == dimensions, "an origin of other dimensions");
  for (const double spacing_m : image.spacing)
    require(spacing_m > 0 && std::isfinite(spacing_m), "a spacing that is not positive");
  for (const double at_m : image.origin) require(std::isfinite(at_m), "an origin that is not finite");
  require(image.as<float>().size() == image.values(), "samples that are no values");
}

}  // namespace

bool metaimage(Bytes bytes) {
  static InputFile file;
  static const Folder folder;
  file.fill(bytes);
  MetaImage image;
  if (!accepted<client::FileError>([&] { image = client::read_metaimage(file.path()); })) return false;
  check(image);
  const auto written = folder.path() / "again.mha";
  client::write_metaimage(written, image);
  const MetaImage again = client::read_metaimage(written);
  require(again.size == image.size && again.spacing == image.spacing && again.origin == image.origin &&
              again.channels == image.channels && again.type == image.type && again.data == image.data,
          "it is read back as another");
  return true;
}

}  // namespace teletact::fuzzers
