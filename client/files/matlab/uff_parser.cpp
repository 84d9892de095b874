#include "client/files/matlab/uff_parser.h"

#include <algorithm>
#include <cmath>

#include "client/files/matlab/hdf5_reader.h"
#include "client/text/shown.h"

namespace teletact::client {

namespace {

using Node = Hdf5Node;

constexpr std::size_t kMaxOnAxis = std::size_t{1} << 20;
constexpr long double kMaxPixels = 1L << 24;  // of a frame
constexpr double kUneven = 0.01;               // of an axis's step
constexpr const char* kBeamformed = "uff.beamformed_data";
constexpr const char* kChannels = "uff.channel_data";

bool is_array(const Node& node) {
  if (H5Aexists(node.id, "array") <= 0) return false;
  const Hdf5Id read(H5Aopen(node.id, "array", H5P_DEFAULT), H5Aclose);
  const Hdf5Id space(read.there() ? H5Aget_space(read) : H5I_INVALID_HID, H5Sclose);
  double value = 0;
  return space.there() && H5Sget_simple_extent_npoints(space) == 1 &&
         H5Aread(read, H5T_NATIVE_DOUBLE, &value) >= 0 && value != 0;
}

class UffReader final : Hdf5Reader {
 public:
  UffReader(const std::filesystem::path& path, std::size_t file_bytes)
      : Hdf5Reader(path, file_bytes, "write it with USTB's write()") {}

  UffImage read(const std::string& object, std::size_t frame) const {
    const Node beamformed = object.empty() ? only_one() : named(object);
    const std::string kind = text_of(beamformed, "class");
    if (kind == kChannels) refuse_channels(beamformed.name);
    if (kind != kBeamformed)
      refuse("'" + shown(beamformed.name) + "' is of the class '" + shown(kind) + "'; give the name of a " +
             kBeamformed + " with --variable");
    if (is_array(beamformed))
      refuse("'" + shown(beamformed.name) +
             "' is an array of objects; give one of them with --variable, such as " + shown(beamformed.name) +
             "/" + shown(names_in(beamformed).empty() ? "" : names_in(beamformed).front()));
    UffImage image;
    read_scan(beamformed, image);
    read_data(beamformed, frame, image);
    image.modulation_frequency_hz = number(child(beamformed, "modulation_frequency"));
    if (image.modulation_frequency_hz && !(*image.modulation_frequency_hz >= 0))
      refuse("'" + shown(beamformed.name) + "/modulation_frequency' is below 0; write it in Hz");
    image.sound_speed_m_s = sound_speed(child(beamformed, "sequence"));
    return image;
  }

 private:
  [[noreturn]] void refuse_channels(const std::string& name) const {
    refuse("'" + shown(name) + "' holds channel data (" + kChannels + "); beamform it first");
  }

  Node named(const std::string& object) const {
    Node at{Hdf5Id(H5Gopen2(root().id, "/", H5P_DEFAULT), H5Gclose), ""};
    for (std::size_t begin = 0; begin < object.size();) {
      const std::size_t end = std::min(object.find('/', begin), object.size());
      if (end > begin) at = child(at, object.substr(begin, end - begin));
      begin = end + 1;
    }
    if (at.name.empty() || !at.is(H5I_GROUP))
      refuse("has no object '" + shown(object) + "'; it has: " + present());
    return at;
  }

  Node only_one() const {
    std::vector<std::string> beamformed, channels;
    for (const std::string& name : names_in(root())) {
      const Node node = child(root(), name);
      if (!node.is(H5I_GROUP)) continue;
      const std::string kind = text_of(node, "class");
      if (kind == kBeamformed) beamformed.push_back(name);
      if (kind == kChannels) channels.push_back(name);
    }
    if (beamformed.size() == 1) return child(root(), beamformed.front());
    if (beamformed.empty() && !channels.empty()) refuse_channels(channels.front());
    if (beamformed.empty()) {
      std::string words = "holds no ";
      words += kBeamformed;
      words += "; write it with USTB's write(). It holds: ";
      refuse(words += present());
    }
    refuse("holds several images; give one with --variable: " + listed(beamformed));
  }

  template <class T>
  std::vector<T> finite(const Node& data, std::size_t values, int along = -1, std::size_t frame = 0) const {
    std::vector<T> out = numbers<T>(data, values, along, frame);
    if (!std::all_of(out.begin(), out.end(), [](T value) { return std::isfinite(value); }))
      refuse_field(data, "holds NaN or infinity; replace or crop them");
    return out;
  }

  std::optional<double> number(const Node& data) const {
    if (!data.there()) return std::nullopt;
    if (count(data) != 1) refuse_field(data, "holds several numbers; it must be one");
    return finite<double>(data, 1).front();
  }

  // Of an array of waves, the first one's.
  std::optional<double> sound_speed(const Node& sequence) const {
    if (!sequence.is(H5I_GROUP)) return std::nullopt;
    if (!is_array(sequence)) return number(child(sequence, "sound_speed"));
    const std::vector<std::string> waves = names_in(sequence);
    if (waves.empty()) return std::nullopt;
    return number(child(child(sequence, waves.front()), "sound_speed"));
  }

  struct Axis {
    std::size_t count;
    double first, step;
  };

  Axis axis(const Node& data) const {
    const std::size_t n = count(data);
    if (n < 2 || n > kMaxOnAxis)
      refuse_field(
          data, "has " + std::to_string(n) + " places; an image needs 2 to " + std::to_string(kMaxOnAxis));
    const std::vector<double> at = whole(data, n);
    const Axis out{n, at.front(), (at.back() - at.front()) / static_cast<double>(n - 1)};
    if (!(out.step > 0)) refuse_field(data, "does not rise; give increasing values (metres)");
    for (std::size_t k = 0; k < n; ++k)
      if (std::abs(at[k] - (out.first + out.step * static_cast<double>(k))) > kUneven * out.step)
        refuse_field(data, "is not evenly spaced; beamform on an even grid");
    return out;
  }

  // All of what has fewer dimensions than an image's frames.
  std::vector<double> whole(const Node& data, std::size_t n) const {
    if (extent_of(data).size[kMaxRank - 1] != 1)
      refuse_field(data, "has too many dimensions; write the object again");
    return finite<double>(data, n);
  }

  void read_scan(const Node& beamformed, UffImage& image) const {
    const Node scan = child(beamformed, "scan");
    if (!scan.is(H5I_GROUP)) refuse_field(scan, "is missing; write the object again, with its scan");
    const std::string kind = text_of(scan, "class");
    if (kind != "uff.linear_scan" || is_array(scan))
      refuse_field(scan, "is " + (is_array(scan) ? std::string("several scans") : "a '" + shown(kind) + "'") +
                             "; A-lines must be parallel: beamform on one uff.linear_scan");
    const Node across = child(scan, "y_axis");
    if (across.there() && count(across) != 1)
      refuse_field(across, "has several places; estimate plane by plane: beamform one of them");
    const Axis x = axis(child(scan, "x_axis")), z = axis(child(scan, "z_axis"));
    if (z.first < 0) refuse_field(child(scan, "z_axis"), "begins above the probe; begin it at 0 m or deeper");
    if (static_cast<long double>(x.count) * static_cast<long double>(z.count) > kMaxPixels)
      refuse_field(scan, "has " + std::to_string(x.count) + " x " + std::to_string(z.count) +
                             " pixels, more than 16 million; beamform fewer lines or depths");
    image.line_count = x.count, image.line_pitch_m = x.step;
    image.sample_count = z.count, image.sample_pitch_m = z.step, image.first_sample_depth_m = z.first;
    require_in_place(
        child(scan, "x"), [&](std::size_t p) { return x.first + x.step * static_cast<double>(p / z.count); },
        image, x.step);
    require_in_place(
        child(scan, "z"), [&](std::size_t p) { return z.first + z.step * static_cast<double>(p % z.count); },
        image, z.step);
  }

  // Where the pixels' places are stated, too, they must be the axes'.
  template <class Place>
  void require_in_place(const Node& places, const Place& place, const UffImage& image, double step) const {
    if (!places.there()) return;
    const std::size_t n = image.sample_count * image.line_count;
    const bool fits = count(places) == n;
    const std::vector<double> at = fits ? whole(places, n) : std::vector<double>{};
    for (std::size_t p = 0; p < at.size(); ++p)
      if (std::abs(at[p] - place(p)) > kUneven * step)
        refuse_field(places,
                     "is not what the axes say: the scan is moved or turned; beamform on one that is not");
    if (!fits) refuse_field(places, "has another number of pixels than the axes; write the object again");
  }

  // MATLAB writes pixels as the fastest dimension of its four, Python (pyuff-ustb) as the slowest.
  Extent pixels_first(const Extent& as_written, std::size_t pixels) const {
    Extent out = as_written;
    if (out.rank > 1 && out.size[0] != pixels && out.size[out.rank - 1] == pixels)
      std::reverse(out.size.begin(), out.size.begin() + static_cast<std::ptrdiff_t>(out.rank));
    return out;
  }

  void read_data(const Node& beamformed, std::size_t frame, UffImage& image) const {
    const Node data = child(beamformed, "data");
    const bool is_complex = data.is(H5I_GROUP);
    const Node first = is_complex ? child(data, "real") : child(beamformed, "data");
    const std::size_t pixels = image.sample_count * image.line_count;
    const Extent written = extent_of(first), extent = pixels_first(written, pixels);
    const auto& size = extent.size;
    if (size[0] != pixels)
      refuse_field(first, "has " + std::to_string(size[0]) + " pixels, the scan " +
                              std::to_string(image.sample_count) + " x " + std::to_string(image.line_count) +
                              "; write the object again");
    if (size[1] != 1 || size[2] != 1)
      refuse_field(first, "has " + std::to_string(size[1]) + " channels and " + std::to_string(size[2]) +
                              " waves; sum them: beamform with compounding");
    if (size[3] == 0) refuse_field(first, "is empty; write the object again");
    require_held(first, static_cast<long double>(pixels));
    image.frame_count = size[3];
    frame = std::min(frame, image.frame_count - 1);
    const int frames = extent.rank < kMaxRank ? -1
                       : size == written.size  ? 0
                                               : static_cast<int>(kMaxRank) - 1;
    image.values = finite<float>(first, pixels, frames, frame);
    if (!is_complex) return;
    const Node second = child(data, "imag");
    if (extent_of(second).size != written.size)
      refuse_field(second, "has another size than the real part; write the object again");
    image.imaginary = finite<float>(second, pixels, frames, frame);
  }
};

}  // namespace

UffImage parse_uff(const std::filesystem::path& path, const std::string& object, std::size_t frame) {
  const std::size_t file_bytes = readable_file_size(path);
  return UffReader(path, file_bytes).read(object, frame);
}

}  // namespace teletact::client
