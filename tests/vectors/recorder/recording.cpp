#include "tests/vectors/recorder/recording.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>

namespace teletact::vectors {
namespace {

// A line for each vector, then its values as the machine holds them (little endian).
constexpr const char* kFirstLine = "teletact vectors 1";

std::uint64_t hash_of(const std::vector<double>& values) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const double value : values) {
    unsigned char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    for (const unsigned char byte : bytes) hash = (hash ^ byte) * 0x100000001b3u;
  }
  return hash;
}

const Vector* find(const std::vector<Vector>& vectors, const std::string& name) {
  const auto at =
      std::find_if(vectors.begin(), vectors.end(), [&](const Vector& v) { return v.name == name; });
  return at == vectors.end() ? nullptr : &*at;
}

double distance(double a, double b) {
  if (a == b || (std::isnan(a) && std::isnan(b))) return 0;
  const double gap = std::abs(a - b);
  return std::isnan(gap) ? std::numeric_limits<double>::infinity() : gap;
}

Difference compare(const Vector& now, const Vector& before) {
  Difference d{now.name, {}};
  if (now.components != before.components || now.rows != before.rows) {
    d.problem = "has " + std::to_string(now.rows) + " x " + std::to_string(now.components) +
                " values, and had " + std::to_string(before.rows) + " x " + std::to_string(before.components);
    return d;
  }
  d.same_bits = hash_of(now.values) == before.hash;
  double largest = 0;
  for (const double value : before.values)
    if (std::isfinite(value)) largest = std::max(largest, std::abs(value));
  std::size_t beyond = 0;
  const std::size_t held = before.values.size() / before.components;
  for (std::size_t row = 0; row < held; ++row) {
    double gap = 0;
    for (std::size_t c = 0; c < now.components; ++c)
      gap = std::max(gap, distance(now.values[row * before.step * now.components + c],
                                   before.values[row * now.components + c]));
    d.absolute = std::max(d.absolute, gap);
    beyond += gap > now.tolerance.relative * largest;
  }
  d.relative = d.absolute == 0 ? 0 : d.absolute / largest;
  d.share = held == 0 ? 0 : static_cast<double>(beyond) / static_cast<double>(held);
  d.within = d.same_bits || d.share <= now.tolerance.share;
  return d;
}

}  // namespace

void Recording::append(const std::string& name, std::size_t components, std::span<const double> values,
                       const Tolerance& tolerance) {
  auto at = std::find_if(vectors_.begin(), vectors_.end(), [&](const Vector& v) { return v.name == name; });
  if (at == vectors_.end()) at = vectors_.insert(at, Vector{name, components, 0, 1, 0, {}, tolerance});
  if (at->components != components || values.size() % components != 0)
    throw std::logic_error(name + ": a row of another size");
  at->values.insert(at->values.end(), values.begin(), values.end());
  at->rows = at->values.size() / components;
}

void Recording::write(const std::filesystem::path& path, std::size_t max_rows) const {
  std::ofstream file(path, std::ios::binary);
  file << kFirstLine << '\n';
  for (const Vector& v : vectors_) {
    const std::size_t step = std::max<std::size_t>(1, (v.rows + max_rows - 1) / max_rows);
    file << v.name << ' ' << v.components << ' ' << v.rows << ' ' << step << ' ' << hash_of(v.values) << '\n';
    for (std::size_t row = 0; row < v.rows; row += step)
      file.write(reinterpret_cast<const char*>(&v.values[row * v.components]),
                 static_cast<std::streamsize>(v.components * sizeof(double)));
  }
  file.close();
  if (!file) throw std::runtime_error(path.string() + ": could not be written");
}

Recording Recording::read(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string line;
  if (!std::getline(file, line) || line != kFirstLine)
    throw std::runtime_error(path.string() + ": holds no vectors; write it with --record");
  Recording recording;
  while (std::getline(file, line)) {
    Vector v;
    std::istringstream words(line);
    words >> v.name >> v.components >> v.rows >> v.step >> v.hash;
    if (!words || v.components == 0 || v.step == 0)
      throw std::runtime_error(path.string() + ": cannot read \"" + line + "\"");
    v.values.resize((v.rows + v.step - 1) / v.step * v.components);
    if (!file.read(reinterpret_cast<char*>(v.values.data()),
                   static_cast<std::streamsize>(v.values.size() * sizeof(double))))
      throw std::runtime_error(path.string() + ": ends within " + v.name);
    recording.vectors_.push_back(std::move(v));
  }
  return recording;
}

std::vector<Difference> compare(const Recording& now, const Recording& before) {
  std::vector<Difference> differences;
  for (const Vector& v : now.vectors()) {
    const Vector* was = find(before.vectors(), v.name);
    differences.push_back(was != nullptr ? compare(v, *was) : Difference{v.name, "was not recorded before"});
  }
  for (const Vector& v : before.vectors())
    if (find(now.vectors(), v.name) == nullptr) differences.push_back({v.name, "is not recorded any more"});
  return differences;
}

std::string to_string(const Difference& d) {
  if (!d.problem.empty()) return d.name + ": " + d.problem;
  if (d.same_bits) return d.name + ": same to the bit";
  char text[200];
  std::snprintf(text, sizeof text, ": differs by %.3g, relative %.3g; %.2g %% of the rows beyond tolerance%s",
                d.absolute, d.relative, 100 * d.share, d.within ? "" : " (TOO MANY)");
  return d.name + text;
}

}  // namespace teletact::vectors
