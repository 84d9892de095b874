#include "client/files/matlab/uff_parser.h"

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <new>
#include <string_view>

#include "client/files/matlab/hdf5_id.h"
#include "client/files/matlab/mat_parser.h"
#include "client/text/shown.h"

namespace teletact::client {

namespace {

constexpr std::size_t kMostListed = 500;     // bytes of the names of what is there
constexpr std::size_t kMostObjects = 1000;   // of a file
constexpr std::size_t kMostClassName = 256;  // bytes
constexpr std::size_t kMostOnAxis = std::size_t{1} << 20;
constexpr long double kMostPixels = 1L << 24;  // of a frame
constexpr double kUneven = 0.01;               // of an axis's step
constexpr int kMostRank = 4;                   // pixels, channels, waves, frames
constexpr const char* kBeamformed = "uff.beamformed_data";
constexpr const char* kChannels = "uff.channel_data";

// An object of the file, and how messages name it.
struct Node {
  Hdf5Id id;
  std::string name;
  bool there() const { return id.there(); }
  bool is(H5I_type_t type) const { return there() && H5Iget_type(id) == type; }
};

Node child(const Node& parent, const std::string& name) {
  Node out{Hdf5Id(), parent.name.empty() ? name : parent.name + "/" + name};
  H5L_info_t link{};
  // Soft links need not be followed, and external ones must not be.
  if (!parent.is(H5I_GROUP) || name.empty() || H5Lexists(parent.id, name.c_str(), H5P_DEFAULT) <= 0 ||
      H5Lget_info(parent.id, name.c_str(), &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD)
    return out;
  out.id = Hdf5Id(H5Oopen(parent.id, name.c_str(), H5P_DEFAULT), H5Oclose);
  return out;
}

// "" where there is none that is a short text.
std::string text_of(const Node& node, const char* attribute) {
  if (H5Aexists(node.id, attribute) <= 0) return "";
  const Hdf5Id read(H5Aopen(node.id, attribute, H5P_DEFAULT), H5Aclose);
  const Hdf5Id type(read.there() ? H5Aget_type(read) : H5I_INVALID_HID, H5Tclose);
  const Hdf5Id space(read.there() ? H5Aget_space(read) : H5I_INVALID_HID, H5Sclose);
  if (!type.there() || H5Tget_class(type) != H5T_STRING || H5Sget_simple_extent_npoints(space) != 1)
    return "";
  if (H5Tis_variable_str(type) > 0) {
    char* text = nullptr;
    if (H5Aread(read, type, static_cast<void*>(&text)) < 0 || text == nullptr) return "";
    std::string out(std::string_view(text).substr(0, kMostClassName));
    H5free_memory(text);
    return out;
  }
  const std::size_t bytes = H5Tget_size(type);
  if (bytes == 0 || bytes > kMostClassName) return "";
  std::string out(bytes, '\0');
  if (H5Aread(read, type, out.data()) < 0) return "";
  return out.c_str();
}

bool is_array(const Node& node) {
  if (H5Aexists(node.id, "array") <= 0) return false;
  const Hdf5Id read(H5Aopen(node.id, "array", H5P_DEFAULT), H5Aclose);
  const Hdf5Id space(read.there() ? H5Aget_space(read) : H5I_INVALID_HID, H5Sclose);
  double value = 0;
  return space.there() && H5Sget_simple_extent_npoints(space) == 1 &&
         H5Aread(read, H5T_NATIVE_DOUBLE, &value) >= 0 && value != 0;
}

std::vector<std::string> names_in(const Node& group) {
  std::vector<std::string> names;
  const auto add = [](hid_t, const char* name, const H5L_info_t*, void* into) -> herr_t {
    auto& all = *static_cast<std::vector<std::string>*>(into);
    if (all.size() == kMostObjects) return 1;
    try {
      all.emplace_back(name);
    } catch (const std::bad_alloc&) {
      return -1;
    }
    return 0;
  };
  H5Literate(group.id, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names);
  return names;
}

class UffReader {
 public:
  UffReader(const std::filesystem::path& path, std::size_t file_bytes)
      : path_(path),
        file_bytes_(file_bytes),
        file_(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose) {
    if (!file_.there()) refuse("is no HDF5 file or is damaged; write it with USTB's write()");
    root_.id = Hdf5Id(H5Gopen2(file_, "/", H5P_DEFAULT), H5Gclose);
  }

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
  [[noreturn]] void refuse(const std::string& words) const { throw FileError(path_, words); }
  [[noreturn]] void refuse_channels(const std::string& name) const {
    refuse("'" + shown(name) + "' holds channel data (" + kChannels + "); beamform it first");
  }
  [[noreturn]] void refuse_field(const Node& field, const std::string& words) const {
    refuse("'" + shown(field.name) + "' " + words);
  }

  [[noreturn]] void refuse_larger(const Node& field) const {
    refuse_field(field, "claims to be larger than the file can hold; the file is damaged: write it again");
  }

  std::string present() const {
    std::string list;
    for (const std::string& name : names_in(root_)) list += (list.empty() ? "" : ", ") + shown(name);
    return list.empty() ? "nothing" : shown(list, kMostListed);
  }

  Node named(const std::string& object) const {
    Node at{Hdf5Id(H5Gopen2(file_, "/", H5P_DEFAULT), H5Gclose), ""};
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
    for (const std::string& name : names_in(root_)) {
      const Node node = child(root_, name);
      if (!node.is(H5I_GROUP)) continue;
      const std::string kind = text_of(node, "class");
      if (kind == kBeamformed) beamformed.push_back(name);
      if (kind == kChannels) channels.push_back(name);
    }
    if (beamformed.size() == 1) return child(root_, beamformed.front());
    if (beamformed.empty() && !channels.empty()) refuse_channels(channels.front());
    if (beamformed.empty()) {
      std::string words = "holds no ";
      words += kBeamformed;
      words += "; write it with USTB's write(). It holds: ";
      refuse(words += present());
    }
    std::string list;
    for (const std::string& name : beamformed) list += (list.empty() ? "" : ", ") + shown(name);
    refuse("holds several images; give one with --variable: " + shown(list, kMostListed));
  }

  // Its sizes, the fastest first, as MATLAB has them; those after the last are 1.
  std::array<std::size_t, kMostRank> sizes(const Node& data) const {
    if (!data.is(H5I_DATASET)) refuse_field(data, "is missing, or is no array; write the object again");
    const Hdf5Id type(H5Dget_type(data.id), H5Tclose), space(H5Dget_space(data.id), H5Sclose),
        made(H5Dget_create_plist(data.id), H5Pclose);
    if (!type.there() || (H5Tget_class(type) != H5T_FLOAT && H5Tget_class(type) != H5T_INTEGER) ||
        H5Tget_size(type) > sizeof(double))
      refuse_field(data, "holds no real numbers; write the object again");
    if (H5Pget_layout(made) == H5D_VIRTUAL || H5Pget_external_count(made) != 0)
      refuse_field(data, "lies in another file; write it into this one");
    const int rank = H5Sget_simple_extent_ndims(space);
    if (rank < 1 || rank > kMostRank)
      refuse_field(data, "has " + std::to_string(rank) + " dimensions; it may have 1 to " +
                             std::to_string(kMostRank) + ": pixels, channels, waves, frames");
    std::array<hsize_t, kMostRank> extent{};
    H5Sget_simple_extent_dims(space, extent.data(), nullptr);
    std::array<std::size_t, kMostRank> out{1, 1, 1, 1};
    for (int k = 0; k < rank; ++k)
      out[static_cast<std::size_t>(k)] = extent[static_cast<std::size_t>(rank - 1 - k)];
    long double bytes = static_cast<long double>(H5Tget_size(type));
    for (const std::size_t n : out) bytes *= static_cast<long double>(n);
    // HDF5 reads what it was not given. What is packed may be larger than the file.
    if (H5Pget_layout(made) != H5D_CHUNKED && static_cast<long double>(H5Dget_storage_size(data.id)) < bytes)
      refuse_larger(data);
    return out;
  }

  std::size_t count(const Node& data) const {
    long double values = 1;
    for (const std::size_t n : sizes(data)) values *= static_cast<long double>(n);
    if (values < 1) refuse_field(data, "is empty; write the object again");
    require_held(data, values);
    return static_cast<std::size_t>(values);
  }

  void require_held(const Node& data, long double values) const {
    if (!can_hold(file_bytes_, values, 1)) refuse_larger(data);
  }

  // `values` numbers of it from the `from`-th on, of the slowest dimension.
  template <class T>
  std::vector<T> numbers(const Node& data, std::size_t values, std::size_t frame, hid_t in_memory) const {
    const Hdf5Id space(H5Dget_space(data.id), H5Sclose);
    if (H5Sget_simple_extent_ndims(space) == kMostRank) {
      const std::array<hsize_t, kMostRank> start{frame, 0, 0, 0};
      std::array<hsize_t, kMostRank> extent{};
      H5Sget_simple_extent_dims(space, extent.data(), nullptr);
      extent[0] = 1;
      H5Sselect_hyperslab(space, H5S_SELECT_SET, start.data(), nullptr, extent.data(), nullptr);
    }
    const hsize_t flat = values;
    const Hdf5Id memory(H5Screate_simple(1, &flat, nullptr), H5Sclose);
    std::vector<T> out(values);
    if (H5Sget_select_npoints(space) != static_cast<hssize_t>(values) ||
        H5Dread(data.id, in_memory, memory, space, H5P_DEFAULT, out.data()) < 0)
      refuse_field(data, "cannot be read; the file is truncated or damaged: write it again");
    if (!std::all_of(out.begin(), out.end(), [](T value) { return std::isfinite(value); }))
      refuse_field(data, "holds NaN or infinity; replace or crop them");
    return out;
  }

  std::optional<double> number(const Node& data) const {
    if (!data.there()) return std::nullopt;
    if (count(data) != 1) refuse_field(data, "holds several numbers; it must be one");
    return numbers<double>(data, 1, 0, H5T_NATIVE_DOUBLE).front();
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
    if (n < 2 || n > kMostOnAxis)
      refuse_field(
          data, "has " + std::to_string(n) + " places; an image needs 2 to " + std::to_string(kMostOnAxis));
    const std::vector<double> at = whole(data, n);
    const Axis out{n, at.front(), (at.back() - at.front()) / static_cast<double>(n - 1)};
    if (!(out.step > 0)) refuse_field(data, "does not rise; it must, in metres");
    for (std::size_t k = 0; k < n; ++k)
      if (std::abs(at[k] - (out.first + out.step * static_cast<double>(k))) > kUneven * out.step)
        refuse_field(data, "is not evenly spaced; beamform on an even grid");
    return out;
  }

  // All of what has fewer dimensions than an image's frames.
  std::vector<double> whole(const Node& data, std::size_t n) const {
    if (sizes(data)[kMostRank - 1] != 1)
      refuse_field(data, "has too many dimensions; write the object again");
    return numbers<double>(data, n, 0, H5T_NATIVE_DOUBLE);
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
    if (static_cast<long double>(x.count) * static_cast<long double>(z.count) > kMostPixels)
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

  void read_data(const Node& beamformed, std::size_t frame, UffImage& image) const {
    const Node data = child(beamformed, "data");
    const bool is_complex = data.is(H5I_GROUP);
    const Node first = is_complex ? child(data, "real") : child(beamformed, "data");
    const auto size = sizes(first);
    const long double pixels =
        static_cast<long double>(image.sample_count) * static_cast<long double>(image.line_count);
    if (static_cast<long double>(size[0]) != pixels)
      refuse_field(first, "has " + std::to_string(size[0]) + " pixels, the scan " +
                              std::to_string(image.sample_count) + " x " + std::to_string(image.line_count) +
                              "; write the object again");
    if (size[1] != 1 || size[2] != 1)
      refuse_field(first, "has " + std::to_string(size[1]) + " channels and " + std::to_string(size[2]) +
                              " waves; sum them: beamform with compounding");
    if (size[3] == 0) refuse_field(first, "is empty; write the object again");
    require_held(first, pixels);
    image.frame_count = size[3];
    frame = std::min(frame, image.frame_count - 1);
    image.values = numbers<float>(first, size[0], frame, H5T_NATIVE_FLOAT);
    if (!is_complex) return;
    const Node second = child(data, "imag");
    if (sizes(second) != size)
      refuse_field(second, "has another size than the real part; write the object again");
    image.imaginary = numbers<float>(second, size[0], frame, H5T_NATIVE_FLOAT);
  }

  const std::filesystem::path path_;
  const std::size_t file_bytes_;
  const Hdf5Id file_;
  Node root_{Hdf5Id(), ""};
};

}  // namespace

UffImage parse_uff(const std::filesystem::path& path, const std::string& object, std::size_t frame) {
  const std::size_t file_bytes = readable_file_size(path);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);  // it would print what we say
  return UffReader(path, file_bytes).read(object, frame);
}

}  // namespace teletact::client
