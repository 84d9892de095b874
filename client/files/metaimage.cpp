#include "client/files/metaimage.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <string_view>

#include "client/text/shown.h"

namespace teletact::client {

static_assert(std::endian::native == std::endian::little, "samples are written as they lie in memory");

namespace {

constexpr std::size_t kLargestHeaderBytes = std::size_t{16} << 20;  // 100 000 frames with their stamps
constexpr long double kLargestCompression = 1100;  // deflate cannot shrink by more than about 1032
constexpr std::size_t kLargestDimension = std::size_t{1} << 24;
constexpr std::size_t kLargestChannels = 4096;

// A type of MetaIO's numbers, and as which of ours it is kept.
struct StoredType {
  const char* name;
  std::size_t bytes;
  bool is_signed;
  ElementType kept;
};
constexpr std::array<StoredType, 10> kTypes{{{"MET_UCHAR", 1, false, ElementType::kUint8},
                                             {"MET_SHORT", 2, true, ElementType::kInt16},
                                             {"MET_FLOAT", 4, true, ElementType::kFloat32},
                                             {"MET_DOUBLE", 8, true, ElementType::kFloat64},
                                             {"MET_CHAR", 1, true, ElementType::kInt16},
                                             {"MET_USHORT", 2, false, ElementType::kFloat32},
                                             {"MET_INT", 4, true, ElementType::kFloat64},
                                             {"MET_UINT", 4, false, ElementType::kFloat64},
                                             {"MET_LONG", 4, true, ElementType::kFloat64},
                                             {"MET_ULONG", 4, false, ElementType::kFloat64}}};

// The first of a kept type is itself.
const StoredType& type_of(ElementType kept) {
  return *std::find_if(kTypes.begin(), kTypes.end(), [&](const StoredType& t) { return t.kept == kept; });
}

// The header's fields, and where it ends.
struct Header {
  std::map<std::string, std::string> fields;
  std::size_t bytes = 0;

  bool has(const std::string& key) const { return fields.contains(key); }
  // As MetaIO reads it: by the first letter.
  bool is_true(const std::string& key, bool where_absent = false) const {
    const auto found = fields.find(key);
    if (found == fields.end()) return where_absent;
    return !found->second.empty() &&
           std::string_view("Tt1").find(found->second.front()) != std::string_view::npos;
  }
};

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

Header read_header(const std::filesystem::path& path, std::size_t file_bytes) {
  std::ifstream in(path, std::ios::binary);
  std::string head(std::min(kLargestHeaderBytes, file_bytes), '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  Header header;
  for (std::size_t end; (end = head.find('\n', header.bytes)) != std::string::npos;) {
    const std::string line = head.substr(header.bytes, end - header.bytes);
    header.bytes = end + 1;
    const auto equals = line.find_first_of("=:");  // MetaIO takes either
    if (equals == std::string::npos) {
      if (!header.has("ObjectType") && !header.has("NDims")) break;
      if (trimmed(line).empty()) continue;
      throw FileError(path, "header line '" + shown(trimmed(line)) + "' has no '='; delete it");
    }
    const std::string key = trimmed(line.substr(0, equals));
    if (!header.fields.emplace(key, trimmed(line.substr(equals + 1))).second)
      throw FileError(path, "header field " + shown(key) + " is given twice; keep one");
    if (key == "ElementDataFile") return header;  // by definition the last one
  }
  if (header.has("NDims") && head.size() == kLargestHeaderBytes)
    throw FileError(path, "its header is longer than 16 MiB; save fewer frames in one file");
  throw FileError(path,
                  "is not a MetaImage: its header has no ElementDataFile line; give an .mha or .mhd file");
}

// Numbers of one field; exactly `count` of them, all finite.
std::vector<double> numbers(const std::filesystem::path& path, const Header& header, const std::string& key,
                            std::size_t count) {
  std::istringstream in(header.fields.at(key));
  std::vector<double> values;
  for (std::string word; in >> word;) {
    char* end = nullptr;
    const double value = std::strtod(word.c_str(), &end);
    if (*end != '\0' || !std::isfinite(value))
      throw FileError(path,
                      "header field " + key + ": '" + shown(word) + "' is not a number; correct the header");
    values.push_back(value);
  }
  if (values.size() != count)
    throw FileError(path, "header field " + key + " has " + std::to_string(values.size()) + " values, not " +
                              std::to_string(count) + "; correct the header");
  return values;
}

std::size_t whole(const std::filesystem::path& path, const std::string& key, double value,
                  std::size_t largest) {
  if (!(value >= 1) || value > static_cast<double>(largest) || value != std::floor(value))
    throw FileError(path, "header field " + key + " must be a whole number from 1 to " +
                              std::to_string(largest) + "; correct the header");
  return static_cast<std::size_t>(value);
}

std::size_t words_in(const std::string& text) {
  std::istringstream in(text);
  return static_cast<std::size_t>(
      std::distance(std::istream_iterator<std::string>(in), std::istream_iterator<std::string>()));
}

// A rotated image would be read with wrong axes: only the identity is accepted.
void check_transform(const std::filesystem::path& path, const Header& header, std::size_t dimensions) {
  for (const std::string key : {"TransformMatrix", "Rotation", "Orientation"}) {  // MetaIO's names for one
    if (!header.fields.contains(key)) continue;
    // SUPRA's and PLUS's of four dimensions may be that of three.
    std::size_t side = dimensions;
    if (side > 3 && words_in(header.fields.at(key)) == 9) side = 3;
    const auto matrix = numbers(path, header, key, side * side);
    for (std::size_t i = 0; i < matrix.size(); ++i)
      if (matrix[i] != (i % (side + 1) == 0 ? 1.0 : 0.0))
        throw FileError(path, key + " is not the identity; resample the image to its own axes");
  }
}

const StoredType& stored_type(const std::filesystem::path& path, const std::string& name) {
  for (const StoredType& type : kTypes)
    if (name == type.name) return type;
  throw FileError(path, "ElementType " + shown(name) +
                            " is not supported; use MET_SHORT, MET_FLOAT, MET_DOUBLE or MET_UCHAR");
}

// Without the third of four dimensions, which is 1: PLUS writes planes so.
void drop_third(const std::filesystem::path& path, MetaImage& image) {
  if (image.size.size() < 4) return;
  if (image.size[2] != 1)
    throw FileError(path, "NDims is 4: each image has " + std::to_string(image.size[2]) +
                              " channels or planes; beamform them, and save samples x A-lines x frames");
  for (auto* list : {&image.spacing, &image.origin})
    if (!list->empty()) list->erase(list->begin() + 2);
  image.size.erase(image.size.begin() + 2);
}

MetaImage described(const std::filesystem::path& path, const Header& header) {
  for (const char* key : {"NDims", "DimSize", "ElementType"})
    if (!header.has(key)) throw FileError(path, std::string("header field ") + key + " is missing; add it");
  if (!header.is_true("BinaryData", true))
    throw FileError(path, "BinaryData = False is not supported; save it as binary");
  const std::size_t dimensions = whole(path, "NDims", numbers(path, header, "NDims", 1)[0], 4);
  if (dimensions < 2) throw FileError(path, "NDims must be 2, 3 or 4; give an image of A-lines");
  check_transform(path, header, dimensions);
  MetaImage image;
  for (const double n : numbers(path, header, "DimSize", dimensions))
    image.size.push_back(whole(path, "DimSize", n, kLargestDimension));
  if (header.has("ElementNumberOfChannels"))
    image.channels = whole(path, "ElementNumberOfChannels",
                           numbers(path, header, "ElementNumberOfChannels", 1)[0], kLargestChannels);
  image.type = stored_type(path, header.fields.at("ElementType")).kept;
  for (const char* key :
       {"ElementSpacing", "ElementSize"}) {  // the latter stands for the former, as in MetaIO
    if (!image.spacing.empty() || !header.has(key)) continue;
    image.spacing = numbers(path, header, key, dimensions);
    for (const double s : image.spacing)
      if (!(s > 0))
        throw FileError(path, std::string("header field ") + key + " must be positive; correct the header");
  }
  for (const char* key : {"Offset", "Position", "Origin"})
    if (image.origin.empty() && header.has(key)) image.origin = numbers(path, header, key, dimensions);
  drop_third(path, image);
  image.fields = header.fields;
  return image;
}

// Bytes the header asks for, without overflow: 3 x 24 bits of dimensions x 12 of channels x 4 can exceed 64.
long double declared_bytes(const MetaImage& image, std::size_t bytes_of_each) {
  long double bytes = static_cast<long double>(image.channels * bytes_of_each);
  for (const std::size_t n : image.size) bytes *= static_cast<long double>(n);
  return bytes;
}

// Where the samples lie.
struct Place {
  std::filesystem::path file;
  std::size_t begin = 0, end = 0;
};

// `declared`: how many bytes they take there; 0: nobody says.
Place place_of(const std::filesystem::path& path, std::size_t file_bytes, const Header& header,
               long double declared) {
  const std::string& name = header.fields.at("ElementDataFile");
  Place place{path, header.bytes, file_bytes};
  if (name != "LOCAL" && name != "Local" && name != "local") {
    // A header from elsewhere must not have other files of this person read.
    const std::filesystem::path beside = name;
    if (name.empty() || beside.has_parent_path() || name == ".." || name.starts_with("LIST") ||
        name.find('%') != std::string::npos)
      throw FileError(path, "ElementDataFile " + shown(name) +
                                " is not one file beside this one; convert it to one .mha file");
    place.file = path.parent_path() / beside;
    place.begin = 0, place.end = readable_file_size(place.file);
  }
  if (!header.has("HeaderSize")) return place;
  const double skipped = numbers(path, header, "HeaderSize", 1)[0];
  const auto size = static_cast<long double>(place.end);
  if (skipped == -1 && declared > 0 && declared <= size)
    place.begin = place.end - static_cast<std::size_t>(declared);
  if (skipped > 0)
    place.begin = std::min(place.end, whole(path, "HeaderSize", skipped, std::size_t{1} << 40));
  return place;
}

[[noreturn]] void refuse_size(const Place& place, long double declared, std::size_t present,
                              const char* packed = "") {
  char problem[200];
  std::snprintf(
      problem, sizeof problem,
      "its header declares %.0Lf bytes of samples but %zu%s follow; the file is %s: copy or export it "
      "again",
      declared, present, packed, declared > static_cast<long double>(present) ? "truncated" : "corrupt");
  throw FileError(place.file, problem);
}

std::vector<std::byte> bytes_at(const Place& place) {
  std::vector<std::byte> out(place.end - place.begin);
  std::ifstream in(place.file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(place.begin));
  in.read(reinterpret_cast<char*>(out.data()), static_cast<std::streamsize>(out.size()));
  if (static_cast<std::size_t>(in.gcount()) != out.size())
    throw FileError(place.file, "could not be read to its end; check the disk");
  return out;
}

// Exactly `declared` of them; packed as zlib or gzip does.
std::vector<std::byte> unpacked(const Place& place, long double declared) {
  std::vector<std::byte> in = bytes_at(place);
  if (declared > kLargestCompression * static_cast<long double>(in.size()))
    refuse_size(place, declared, in.size(), " packed ones");
  std::vector<std::byte> out(static_cast<std::size_t>(declared));
  z_stream stream{};
  constexpr int kZlibOrGzip = 32 + MAX_WBITS;
  if (inflateInit2(&stream, kZlibOrGzip) != Z_OK) throw std::bad_alloc();
  int result = Z_OK;
  for (std::size_t taken = 0, made = 0; result == Z_OK;) {
    constexpr std::size_t kMax = std::size_t{1} << 30;  // zlib counts in 32 bits
    stream.next_in = reinterpret_cast<Bytef*>(in.data() + taken);
    stream.avail_in = static_cast<uInt>(std::min(kMax, in.size() - taken));
    stream.next_out = reinterpret_cast<Bytef*>(out.data() + made);
    stream.avail_out = static_cast<uInt>(std::min(kMax, out.size() - made));
    result = inflate(&stream, Z_NO_FLUSH);
    taken = static_cast<std::size_t>(reinterpret_cast<std::byte*>(stream.next_in) - in.data());
    made = static_cast<std::size_t>(reinterpret_cast<std::byte*>(stream.next_out) - out.data());
    if (result == Z_STREAM_END && made != out.size()) result = Z_BUF_ERROR;
  }
  inflateEnd(&stream);
  if (result != Z_STREAM_END)
    throw FileError(place.file,
                    "its packed samples are damaged, or not as many as its header declares; export it again");
  return out;
}

void swap_bytes(std::vector<std::byte>& data, std::size_t of_each) {
  for (std::size_t at = 0; at + of_each <= data.size(); at += of_each)
    std::reverse(data.begin() + static_cast<std::ptrdiff_t>(at),
                 data.begin() + static_cast<std::ptrdiff_t>(at + of_each));
}

// The stored integers as `To`, each of which holds them exactly.
template <class To>
std::vector<std::byte> widened(const std::vector<std::byte>& data, const StoredType& from) {
  std::vector<std::byte> out(data.size() / from.bytes * sizeof(To));
  for (std::size_t k = 0; k < data.size() / from.bytes; ++k) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, data.data() + k * from.bytes, from.bytes);
    const std::uint32_t sign = std::uint32_t{1} << (8 * from.bytes - 1);
    const std::int64_t value =
        static_cast<std::int64_t>(bits) -
        (from.is_signed && (bits & sign) != 0 ? std::int64_t{1} << (8 * from.bytes) : std::int64_t{0});
    const To kept = static_cast<To>(value);
    std::memcpy(out.data() + k * sizeof(To), &kept, sizeof(To));
  }
  return out;
}

std::vector<std::byte> kept(std::vector<std::byte> data, const StoredType& from) {
  if (&from == &type_of(from.kept)) return data;
  if (from.kept == ElementType::kInt16) return widened<std::int16_t>(data, from);
  if (from.kept == ElementType::kFloat32) return widened<float>(data, from);
  return widened<double>(data, from);
}

}  // namespace

std::size_t element_bytes(ElementType type) {
  return type_of(type).bytes;
}

std::size_t MetaImage::values() const {
  std::size_t n = channels;
  for (const std::size_t s : size) n *= s;
  return n;
}

std::string MetaImage::field(const std::string& name) const {
  const auto found = fields.find(name);
  return found == fields.end() ? "" : found->second;
}

MetaImage read_metaimage(const std::filesystem::path& path) {
  const std::size_t file_bytes = readable_file_size(path);
  const Header header = read_header(path, file_bytes);
  MetaImage image = described(path, header);
  const StoredType& stored = stored_type(path, header.fields.at("ElementType"));
  const long double declared = declared_bytes(image, stored.bytes);
  const bool is_packed = header.is_true("CompressedData");
  const bool says_packed = is_packed && header.has("CompressedDataSize");
  const Place place = place_of(path, file_bytes, header,
                               says_packed ? numbers(path, header, "CompressedDataSize", 1)[0]
                               : is_packed ? 0
                                           : declared);
  if (!is_packed && declared != static_cast<long double>(place.end - place.begin))
    refuse_size(place, declared, place.end - place.begin);
  std::vector<std::byte> data = is_packed ? unpacked(place, declared) : bytes_at(place);
  if (header.is_true("BinaryDataByteOrderMSB") || header.is_true("ElementByteOrderMSB"))
    swap_bytes(data, stored.bytes);
  image.data = kept(std::move(data), stored);
  return image;
}

void write_metaimage(const std::filesystem::path& path, const MetaImage& image) {
  const std::size_t dimensions = image.size.size();
  if (dimensions < 2 || dimensions > 3)
    throw std::invalid_argument("MetaImage.size must have 2 or 3 dimensions");
  if (image.data.size() != image.values() * element_bytes(image.type))
    throw std::invalid_argument("MetaImage.data does not fill size x channels");
  for (const auto* list : {&image.spacing, &image.origin})
    if (!list->empty() && list->size() != dimensions)
      throw std::invalid_argument("MetaImage.spacing and origin need one value per dimension");
  const auto listed = [](const char* key, const auto& values) {
    std::ostringstream out;
    out.precision(17);
    out << key << " =";
    for (const auto v : values) out << ' ' << v;
    out << '\n';
    return out.str();
  };
  std::string header = "ObjectType = Image\nNDims = " + std::to_string(dimensions) +
                       "\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n";
  if (!image.origin.empty()) header += listed("Offset", image.origin);
  if (!image.spacing.empty()) header += listed("ElementSpacing", image.spacing);
  header += listed("DimSize", image.size);
  if (image.channels > 1) header += "ElementNumberOfChannels = " + std::to_string(image.channels) + "\n";
  header += std::string("ElementType = ") + type_of(image.type).name + "\nElementDataFile = LOCAL\n";
  write_file(path, header, image.data);
}

}  // namespace teletact::client
