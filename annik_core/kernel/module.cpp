// The Python module annik_core.kernel.compiled.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "gantry.hpp"
#include "network.hpp"
#include "search.hpp"

namespace py = pybind11;

namespace annik {
namespace {

// Converted where it must be: another type, order of bytes, layout or alignment.
using Array = py::array_t<double, py::array::c_style | py::array::forcecast |
                                      py::detail::npy_api::NPY_ARRAY_ALIGNED_>;

// Shared, not converted.
using Memory = py::array_t<double, py::array::c_style>;

void check_shape(const py::array& array, std::initializer_list<py::ssize_t> shape, const char* name) {
  bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size());
  std::string text;
  py::ssize_t axis = 0;
  for (const py::ssize_t wanted : shape) {
    fits = fits && array.shape(axis) == wanted;
    text += (axis++ ? ", " : "") + std::to_string(wanted);
  }
  if (!fits) throw std::invalid_argument(std::string(name) + " must have the shape (" + text + ")");
}

Placement placement_of(const double* pose) {
  return {rotation_of(pose + 3), {pose[0], pose[1], pose[2]}};
}

void write_pose(const Placement& placement, double* pose) {
  const auto quaternion = quaternion_of(placement.rotation);
  std::copy(placement.position.begin(), placement.position.end(), pose);
  std::copy(quaternion.begin(), quaternion.end(), pose + 3);
}

Joints joints_from(const double* numbers, py::ssize_t count) {
  Joints joints{};
  std::copy_n(numbers, count, joints.begin());
  return joints;
}

std::vector<double> numbers_of(const Array& array) {
  return {array.data(), array.data() + array.size()};
}

// Row by row.
void write_jacobian(const Jacobian& jacobian, py::ssize_t dof, double* numbers) {
  for (std::size_t row = 0; row < 6; ++row)
    for (py::ssize_t joint = 0; joint < dof; ++joint) *numbers++ = jacobian[joint][row];
}

// The rotation from the z axis to a unit vector, by the shortest way.
Rotation z_towards(const Vector3& axis) {
  if (axis[2] < -1.0 + 1e-9 && std::hypot(axis[0], axis[1]) < 1e-9)
    return {{1.0, 0.0, 0.0}, {0.0, -1.0, 0.0}, {0.0, 0.0, -1.0}};
  const Vector3 about = cross({0.0, 0.0, 1.0}, axis);
  const double sine = norm(about);
  const double angle = std::atan2(sine, axis[2]);
  return rotation_about((sine > 0.0 ? angle / sine : 0.0) * about);
}

// Runs ``work(row)`` for all rows, in blocks, on several threads.
template <typename Work>
void for_rows(std::size_t rows, int threads, const Work& work) {
  constexpr std::size_t BLOCK = 16;
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    while (true) {
      const std::size_t begin = next.fetch_add(BLOCK);
      if (begin >= rows) return;
      for (std::size_t row = begin; row < std::min(rows, begin + BLOCK); ++row) work(row);
    }
  };
  const std::size_t most = std::min<std::size_t>(threads, (rows + BLOCK - 1) / BLOCK);
  std::vector<std::thread> others;
  try {
    for (std::size_t thread = 1; thread < most; ++thread) others.emplace_back(run);
  } catch (const std::system_error&) {  // no more threads are to be had: these do it too
  }
  run();
  for (std::thread& thread : others) thread.join();
}

// Of an object of Python. ``__new__`` alone gives one memory without calling its constructor: that
// memory is zero, so that such an object has no joints.
struct Object {
  static void* operator new(std::size_t size) {
    if (void* memory = std::calloc(1, size)) return memory;
    throw std::bad_alloc();
  }
  static void operator delete(void* memory) { std::free(memory); }

  static py::ssize_t constructed(py::ssize_t dof) {
    if (dof == 0) throw py::type_error("it was made without its constructor");
    return dof;
  }
};

}  // namespace

// A chain as Python sees it. It never changes, so threads may share it.
class PyChain : public Object {
 public:
  // ``corrections``: None, or ArmCorrections of robots/corrections.py, with which ``placements``
  // have been moved already; ``nominal``: those without.
  PyChain(const Array& placements, const Array& axes, const py::object& corrections,
          const Array& nominal, const std::vector<std::size_t>& wrapped, const Array& centre) {
    const py::ssize_t dof = axes.ndim() == 2 ? axes.shape(0) : 0;
    if (dof < 1 || dof > static_cast<py::ssize_t>(MAX_JOINTS))
      throw std::invalid_argument("axes must have 1 to 32 rows, one a joint");
    check_shape(axes, {dof, 6}, "axes");
    check_shape(placements, {dof + 1, 4, 4}, "placements");
    check_shape(nominal, {dof + 1, 4, 4}, "nominal");
    chain_.end_effector = joints_of(placements, axes, chain_.joints);
    if (!corrections.is_none()) {
      const py::object harmonics = corrections.attr("joint_harmonics");
      const py::object joint_networks = corrections.attr("joint_networks");
      const py::object pose_network = corrections.attr("pose_network");
      const py::object deflection = corrections.attr("deflection");
      const py::object pose_harmonics = corrections.attr("pose_harmonics");
      if (!harmonics.is_none()) set_joint_harmonics(harmonics);
      if (!joint_networks.is_none()) set_joint_networks(joint_networks);
      if (!pose_network.is_none()) set_pose_network(pose_network);
      if (!deflection.is_none()) set_deflection(deflection, nominal, axes);
      if (!pose_harmonics.is_none()) set_pose_harmonics(pose_harmonics);
    }
    if (wrapped.empty()) return;
    check_shape(centre, {dof}, "centre");
    for (const std::size_t joint : wrapped)
      if (joint >= chain_.size()) throw std::invalid_argument("no such joint");
    chain_.wrapped = wrapped;
    chain_.wrap_centre = joints_from(centre.data(), dof);
  }

  Array poses(const Array& joint_positions) const {
    const py::ssize_t rows = joint_positions.ndim() ? joint_positions.shape(0) : 0;
    check_shape(joint_positions, {rows, dof()}, "joint_positions");
    Array result({rows, py::ssize_t{7}});
    const double* from = joint_positions.data();
    double* to = result.mutable_data();
    py::gil_scoped_release release;
    for (py::ssize_t row = 0; row < rows; ++row, from += dof(), to += 7)
      write_pose(chain_.pose(joints_from(from, dof())), to);
    return result;
  }

  Array jacobians(const Array& joint_positions) const {
    const py::ssize_t rows = joint_positions.ndim() ? joint_positions.shape(0) : 0;
    check_shape(joint_positions, {rows, dof()}, "joint_positions");
    Array result({rows, py::ssize_t{6}, dof()});
    const double* from = joint_positions.data();
    double* to = result.mutable_data();
    py::gil_scoped_release release;
    Jacobian jacobian;
    for (py::ssize_t row = 0; row < rows; ++row, from += dof(), to += 6 * dof()) {
      chain_.jacobian(joints_from(from, dof()), jacobian);
      write_jacobian(jacobian, dof(), to);
    }
    return result;
  }

  py::tuple linearise(const Array& joint_positions, const Array& target) const {
    check_shape(joint_positions, {dof()}, "joint_positions");
    check_shape(target, {7}, "target");
    Linearisation linear;
    chain_.linearise(joints_from(joint_positions.data(), dof()), placement_of(target.data()),
                     linear);
    Array twist(6), jacobian({py::ssize_t{6}, dof()}), displacement(3);
    std::copy_n(linear.twist.begin(), 6, twist.mutable_data());
    write_jacobian(linear.jacobian, dof(), jacobian.mutable_data());
    std::copy_n(linear.displacement.begin(), 3, displacement.mutable_data());
    return py::make_tuple(twist, jacobian, displacement);
  }

  py::tuple residuals(const Array& joint_positions, const Array& target) const {
    check_shape(joint_positions, {dof()}, "joint_positions");
    check_shape(target, {7}, "target");
    Linearisation linear;
    chain_.linearise(joints_from(joint_positions.data(), dof()), placement_of(target.data()),
                     linear);
    return py::make_tuple(linear.position_residual(), linear.orientation_residual());
  }

  const Chain& chain() const {
    dof();
    return chain_;
  }

 private:
  py::ssize_t dof() const { return constructed(static_cast<py::ssize_t>(chain_.size())); }

  // Turning or moving about z axes; returns the end effector in the last joint's frame.
  static Placement joints_of(const Array& placements, const Array& axes,
                             std::vector<Joint>& joints) {
    // From the frame whose z axis is that of the joint before, to that joint's own.
    Placement back;
    for (py::ssize_t joint = 0;; ++joint) {
      const double* m = placements.data(joint);
      const Placement placement =
          back * Placement{{{m[0], m[4], m[8]}, {m[1], m[5], m[9]}, {m[2], m[6], m[10]}},
                           {m[3], m[7], m[11]}};
      if (joint == axes.shape(0)) return placement;
      const double* a = axes.data(joint);
      const bool turns = a[3] != 0.0 || a[4] != 0.0 || a[5] != 0.0;
      const Rotation axis = z_towards(turns ? Vector3{a[3], a[4], a[5]}
                                            : Vector3{a[0], a[1], a[2]});
      back = Placement{axis.inverse(), {0.0, 0.0, 0.0}};
      joints.push_back({{placement.rotation * axis, placement.position}, turns});
    }
  }

  void set_joint_harmonics(const py::object& part) {
    const Array frequencies = array_of(part, "frequencies");
    const Array sines = array_of(part, "sines"), cosines = array_of(part, "cosines");
    const py::ssize_t orders = sines.ndim() == 2 ? sines.shape(1) : 0;
    check_shape(frequencies, {dof()}, "frequencies");
    check_shape(sines, {dof(), orders}, "sines");
    check_shape(cosines, {dof(), orders}, "cosines");
    chain_.joint_harmonics =
        JointHarmonics{static_cast<std::size_t>(orders), joints_from(frequencies.data(), dof()),
                       column_by_column(sines), column_by_column(cosines)};
  }

  void set_deflection(const py::object& part, const Array& nominal, const Array& axes) {
    const Array compliances = array_of(part, "compliances"), gravity = array_of(part, "gravity");
    check_shape(compliances, {dof(), dof()}, "compliances");
    check_shape(gravity, {3}, "gravity");
    Deflection deflection;
    deflection.end_effector = joints_of(nominal, axes, deflection.joints);
    deflection.gravity = {*gravity.data(0), *gravity.data(1), *gravity.data(2)};
    deflection.compliances = numbers_of(compliances);
    chain_.deflection = std::move(deflection);
  }

  void set_joint_networks(const py::object& part) {
    const Array input = array_of(part, "input_weights"), bias = array_of(part, "biases");
    const Array output = array_of(part, "output_weights");
    const py::ssize_t hidden = input.ndim() == 2 ? input.shape(1) : 0;
    check_shape(input, {dof(), hidden}, "input_weights");
    check_shape(bias, {dof(), hidden}, "biases");
    check_shape(output, {dof(), hidden}, "output_weights");
    chain_.joint_scaling = scaling_of(part);
    chain_.joint_networks = JointNetworks{static_cast<std::size_t>(hidden), numbers_of(input),
                                          numbers_of(bias), numbers_of(output)};
  }

  void set_pose_network(const py::object& part) {
    const Array input = array_of(part, "input_weights"), bias = array_of(part, "biases");
    const Array output = array_of(part, "output_weights");
    const py::ssize_t hidden = bias.ndim() == 1 ? bias.shape(0) : 0;
    check_shape(input, {hidden, dof()}, "input_weights");
    check_shape(bias, {hidden}, "biases");
    check_shape(output, {6, hidden}, "output_weights");
    chain_.pose_scaling = scaling_of(part);
    chain_.pose_network = PoseNetwork{static_cast<std::size_t>(hidden), numbers_of(input),
                                      numbers_of(bias), column_by_column(output)};
  }

  void set_pose_harmonics(const py::object& part) {
    const Array waves = array_of(part, "waves");
    const Array cosines = array_of(part, "cosines"), sines = array_of(part, "sines");
    const py::ssize_t count = waves.ndim() == 2 ? waves.shape(0) : 0;
    check_shape(waves, {count, dof()}, "waves");
    check_shape(cosines, {6, count}, "cosines");
    check_shape(sines, {6, count}, "sines");
    const std::vector<double> all = numbers_of(waves);
    const std::vector<double> of_cosines = column_by_column(cosines);
    const std::vector<double> of_sines = column_by_column(sines);
    PoseHarmonics harmonics;
    for (py::ssize_t wave = 0; wave < count; ++wave)
      harmonics.add({all.data() + wave * dof(), all.data() + (wave + 1) * dof()},
                    of_cosines.data() + wave * 6, of_sines.data() + wave * 6);
    chain_.pose_harmonics = std::move(harmonics);
  }

  static std::vector<double> column_by_column(const Array& matrix) {
    std::vector<double> numbers;
    for (py::ssize_t column = 0; column < matrix.shape(1); ++column)
      for (py::ssize_t row = 0; row < matrix.shape(0); ++row)
        numbers.push_back(*matrix.data(row, column));
    return numbers;
  }

  static Array array_of(const py::object& part, const char* name) {
    return part.attr(name).cast<Array>();
  }

  Scaling scaling_of(const py::object& part) const {
    const Array centre = array_of(part, "centre"), half_width = array_of(part, "half_width");
    check_shape(centre, {dof()}, "centre");
    check_shape(half_width, {dof()}, "half_width");
    return {joints_from(centre.data(), dof()), joints_from(half_width.data(), dof())};
  }

  Chain chain_;
};

// A feedforward network as Python sees it. It never changes, so threads may share it.
class PyNetwork : public Object {
 public:
  // Of each layer: the vectors that it takes and that it adds to its output, or None; 0 is the
  // network's input, 1 the first layer's output; its weights (outputs, inputs), its bias
  // (outputs,), and whether it ends in tanh.
  using LayerOfPython = std::tuple<std::size_t, std::optional<std::size_t>, Array, Array, bool>;

  PyNetwork(std::size_t inputs, const std::vector<LayerOfPython>& layers) {
    if (inputs < 1 || inputs > MOST || layers.empty() || layers.size() > MOST)
      throw std::invalid_argument("a network has 1 to 1,000 inputs and layers");
    std::vector<std::pair<std::size_t, std::size_t>> vectors{{0, inputs}};  // begin, size
    network_.inputs = network_.values = inputs;
    for (const auto& [source, addend, weights, bias, bends] : layers) {
      const py::ssize_t rows = bias.ndim() == 1 ? bias.shape(0) : 0;
      if (source >= vectors.size() || addend.value_or(0) >= vectors.size())
        throw std::invalid_argument("a layer takes only what is computed before it");
      const auto [begin, size] = vectors[source];
      const auto [added, length] = vectors[addend.value_or(0)];
      if (rows < 1 || rows > static_cast<py::ssize_t>(MOST))
        throw std::invalid_argument("a layer has 1 to 1,000 outputs");
      check_shape(weights, {rows, static_cast<py::ssize_t>(size)}, "weights");
      if (addend && length != static_cast<std::size_t>(rows))
        throw std::invalid_argument("a layer adds a vector as long as its output");
      network_.layers.push_back({begin, added, network_.values, size,
                                 static_cast<std::size_t>(rows), addend.has_value(), bends,
                                 numbers_of(weights), numbers_of(bias)});
      vectors.emplace_back(network_.values, rows);
      network_.values += rows;
    }
  }

  Array run(const Array& input) const {
    constructed(static_cast<py::ssize_t>(network_.inputs));
    check_shape(input, {static_cast<py::ssize_t>(network_.inputs)}, "input");
    Array output(outputs());
    network_.run(input.data(), output.mutable_data());
    return output;
  }

  const Network& network() const {
    constructed(static_cast<py::ssize_t>(network_.inputs));
    return network_;
  }

  py::ssize_t outputs() const { return network_.layers.back().outputs; }

 private:
  static constexpr std::size_t MOST = 1000;

  Network network_;
};

// The bound of a calibrated robot's pose error, as robots/corrections.py describes it.
class PyErrorBound : public Object {
 public:
  PyErrorBound(const Array& centre, const Array& half_width, const Array& coefficients)
      : dof_(centre.ndim() == 1 ? centre.shape(0) : 0) {
    if (dof_ < 1 || dof_ > static_cast<py::ssize_t>(MAX_JOINTS))
      throw std::invalid_argument("centre must have 1 to 32 numbers, one a joint");
    check_shape(half_width, {dof_}, "half_width");
    check_shape(coefficients, {2, 1 + dof_ + dof_ * (dof_ + 1) / 2}, "coefficients");
    scaling_ = {joints_from(centre.data(), dof_), joints_from(half_width.data(), dof_)};
    coefficients_.assign(coefficients.data(), coefficients.data() + coefficients.size());
  }

  py::tuple at(const Array& joint_positions) const {
    check_shape(joint_positions, {constructed(dof_)}, "joint_positions");
    Joints x;
    for (py::ssize_t i = 0; i < dof_; ++i) {
      const double scaled = (joint_positions.data()[i] - scaling_.centre[i]) / scaling_.half_width[i];
      x[i] = std::min(std::max(scaled, -1.0), 1.0);
    }
    const double* coefficient = coefficients_.data();
    const auto bound = [&] {
      double exponent = *coefficient++;
      for (py::ssize_t i = 0; i < dof_; ++i) exponent += *coefficient++ * x[i];
      for (py::ssize_t i = 0; i < dof_; ++i)
        for (py::ssize_t j = i; j < dof_; ++j) exponent += *coefficient++ * x[i] * x[j];
      return std::exp(exponent);
    };
    const double position = bound();
    return py::make_tuple(position, bound());
  }

 private:
  py::ssize_t dof_;
  Scaling scaling_;
  std::vector<double> coefficients_;
};

class PyRefinement : public Object {
 public:
  PyRefinement(const PyChain& chain, const Array& lower, const Array& upper, int max_newton_steps,
               double tolerance)
      : dof_(static_cast<py::ssize_t>(chain.chain().size())) {
    check_shape(lower, {dof_}, "lower");
    check_shape(upper, {dof_}, "upper");
    refinement_.chain = chain.chain();
    refinement_.lower = joints_from(lower.data(), dof_);
    refinement_.upper = joints_from(upper.data(), dof_);
    for (py::ssize_t joint = 0; joint < dof_; ++joint)
      if (lower.data()[joint] < upper.data()[joint]) refinement_.free.push_back(joint);
    if (refinement_.free.empty()) throw std::invalid_argument("no joint moves");
    refinement_.max_newton_steps = max_newton_steps;
    refinement_.tolerance = tolerance;
  }

  py::tuple refine(const Array& start, const Array& target) const {
    check_shape(start, {dof()}, "start");
    check_shape(target, {7}, "target");
    const Refined found =
        refinement_.refine(joints_from(start.data(), dof_), placement_of(target.data()));
    Array positions(dof_);
    std::copy_n(found.joint_positions.begin(), dof_, positions.mutable_data());
    return py::make_tuple(std::move(positions), found.position_residual,
                          found.orientation_residual, found.newton_steps, found.converged);
  }

  py::tuple refine_batch(const Array& starts, const Array& targets, int threads) const {
    const py::ssize_t rows = starts.ndim() ? starts.shape(0) : 0;
    check_shape(starts, {rows, dof()}, "starts");
    check_shape(targets, {rows, 7}, "targets");
    if (threads < 1) throw std::invalid_argument("threads must be at least 1");
    Array positions({rows, dof_}), distances(rows), angles(rows);
    py::array_t<int> steps(rows);
    py::array_t<bool> converged(rows);
    const double *from = starts.data(), *to = targets.data();
    double* found = positions.mutable_data();
    double *distance = distances.mutable_data(), *angle = angles.mutable_data();
    int* taken = steps.mutable_data();
    bool* ended = converged.mutable_data();
    {
      py::gil_scoped_release release;
      for_rows(rows, threads, [&](std::size_t row) {
        const Refined result =
            refinement_.refine(joints_from(from + row * dof_, dof_), placement_of(to + 7 * row));
        std::copy_n(result.joint_positions.begin(), dof_, found + row * dof_);
        distance[row] = result.position_residual;
        angle[row] = result.orientation_residual;
        taken[row] = result.newton_steps;
        ended[row] = result.converged;
      });
    }
    return py::make_tuple(positions, distances, angles, steps, converged);
  }

  const Refinement& refinement() const {
    dof();
    return refinement_;
  }

 private:
  py::ssize_t dof() const { return constructed(dof_); }

  py::ssize_t dof_;
  Refinement refinement_;
};

Array read_only(const double* numbers, py::ssize_t count) {
  Array array(count);
  std::copy_n(numbers, count, array.mutable_data());
  py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  return array;
}

class PySearch : public Object {
 public:
  PySearch(const PyRefinement& refinement, std::size_t examples, double length)
      : dof_(static_cast<py::ssize_t>(refinement.refinement().chain.size())),
        search_(checked(refinement.refinement(), examples, length), examples, length) {}

  py::tuple first(const Array& target, const Array& starts, std::size_t most) const {
    constructed(dof_);
    check_shape(target, {7}, "target");
    return tuple_of(search_.first(placement_of(target.data()), rows(starts), most));
  }

  py::tuple all(const Array& target, const Array& starts, std::size_t most, double spacing) const {
    constructed(dof_);
    check_shape(target, {7}, "target");
    const std::vector<Joints> begin = rows(starts);
    const Placement goal = placement_of(target.data());
    std::size_t taken = 0;
    std::vector<Solution> found;
    {
      py::gil_scoped_release release;
      found = search_.all(goal, begin, most, spacing, taken);
    }
    const auto count = static_cast<py::ssize_t>(found.size());
    Array positions({count, dof_}), distances(count), angles(count);
    for (py::ssize_t i = 0; i < count; ++i) {
      std::copy_n(found[i].joint_positions.begin(), dof_, positions.mutable_data() + i * dof_);
      distances.mutable_data()[i] = found[i].position_residual;
      angles.mutable_data()[i] = found[i].orientation_residual;
    }
    return py::make_tuple(positions, distances, angles, taken);
  }

  py::tuple follow(const Array& previous, const Array& target) const {
    constructed(dof_);
    check_shape(previous, {dof_}, "previous");
    check_shape(target, {7}, "target");
    return tuple_of(
        search_.follow(joints_from(previous.data(), dof_), placement_of(target.data())));
  }

  bool same_branch(const Array& first, const Array& second) const {
    constructed(dof_);
    check_shape(first, {dof_}, "first");
    check_shape(second, {dof_}, "second");
    return search_.same_branch(joints_from(first.data(), dof_),
                               joints_from(second.data(), dof_));
  }

  py::tuple tuple_of(const Found& found) const {
    return py::make_tuple(read_only(found.joint_positions.data(), dof_), found.position_residual,
                          found.orientation_residual, found.effort, found.found);
  }

  const Search& search(py::ssize_t dof) const {
    if (constructed(dof_) != dof) throw std::invalid_argument("the search is of another robot");
    return search_;
  }

 private:
  static const Refinement& checked(const Refinement& refinement, std::size_t examples,
                                   double length) {
    if (refinement.free.empty()) throw std::invalid_argument("no joint moves");
    for (std::size_t joint = 0; joint < refinement.chain.size(); ++joint)
      if (!std::isfinite(refinement.lower[joint]) || !std::isfinite(refinement.upper[joint]))
        throw std::invalid_argument("the limits must be finite");
    if (examples > 1'000'000) throw std::invalid_argument("examples must be at most a million");
    if (!(length > 0.0)) throw std::invalid_argument("length must be positive");
    return refinement;
  }

  std::vector<Joints> rows(const Array& array) const {
    const py::ssize_t count = array.ndim() ? array.shape(0) : 0;
    check_shape(array, {count, dof_}, "starts");
    std::vector<Joints> result;
    for (py::ssize_t row = 0; row < count; ++row)
      result.push_back(joints_from(array.data() + row * dof_, dof_));
    return result;
  }

  py::ssize_t dof_;
  Search search_;
};

// A pose as an array of its own, its quaternion normalised; nothing if it may not be one.
std::optional<Array> certain_pose(const py::object& pose, double norm_tolerance) {
  constexpr double ROUNDING = 4 * std::numeric_limits<double>::epsilon();
  const Array given = Array::ensure(pose);
  if (!given || given.ndim() != 1 || given.shape(0) != 7) return {};
  Array target(7);
  double* p = target.mutable_data();
  std::copy_n(given.data(), 7, p);
  const double length = std::sqrt(p[3] * p[3] + p[4] * p[4] + p[5] * p[5] + p[6] * p[6]);
  const double deviation = std::abs(length - 1.0);
  // Not '>=', so that NaN is none.
  if (!(deviation < norm_tolerance)) return {};
  if (deviation > ROUNDING)
    for (int part = 3; part < 7; ++part) p[part] /= length;
  return target;
}

template <typename Number>
Number* aligned(Number* memory) {
  if (reinterpret_cast<std::uintptr_t>(memory) % alignof(double))
    throw std::invalid_argument("memory must be aligned");
  return memory;
}

// One target at a time, through memory that is bound to a network. It decides only what is certain:
// every doubtful target is left to Python, which says why it is refused.
class PyBoundSolve : public Object {
 public:
  // ``input``, ``output``: the network's features (13,) and joint positions (dof,); see
  // model/session.py. ``centre``, ``reach``: the ball of positions that the arm reaches.
  PyBoundSolve(const PyRefinement& refinement, const Memory& input, const Memory& output,
               const Array& centre, double reach, const Array& lower, const Array& upper,
               double max_position_residual, double max_orientation_residual, double norm_tolerance)
      : refinement_(refinement.refinement()),
        dof_(static_cast<py::ssize_t>(refinement_.chain.size())),
        input_(input),
        output_(output),
        reach_(reach),
        most_{max_position_residual, max_orientation_residual},
        norm_tolerance_(norm_tolerance) {
    check_shape(input, {13}, "input");
    check_shape(output, {dof_}, "output");
    check_shape(centre, {3}, "centre");
    check_shape(lower, {dof_}, "lower");
    check_shape(upper, {dof_}, "upper");
    std::copy_n(centre.data(), 3, centre_.begin());
    lower_ = joints_from(lower.data(), dof_);
    upper_ = joints_from(upper.data(), dof_);
    features_ = aligned(input_.mutable_data());
    found_ = aligned(output_.data());
  }

  // The checked pose and no reference, its features written to the network's input; None if it may
  // be refused.
  py::object prepare(const py::object& pose) {
    std::optional<Array> target = certain_target(pose);
    if (!target) return py::none();
    return py::make_tuple(std::move(*target), py::tuple());
  }

  // :meth:`prepare`, a network of the kernel, and :meth:`finish`: target, no reference and what
  // that gives.
  py::object solve(const PyNetwork& network, const py::object& pose) {
    const std::optional<Array> target = certain_target(pose);
    if (!target) return py::none();
    run(network);
    py::object found = finish(*target);
    if (found.is_none()) return found;
    return py::make_tuple(*target, py::tuple(), std::move(found));
  }

  // Joint positions, residuals and steps for the network's output, or None if a check may refuse.
  py::object finish(const Array& target) const {
    constructed(dof_);
    check_shape(target, {7}, "target");
    if (!finite_output()) return py::none();
    const Refined found =
        refinement_.refine(joints_from(found_, dof_), placement_of(target.data()));
    if (!found.converged || !acceptable(found)) return py::none();
    return py::make_tuple(read_only(found.joint_positions.data(), dof_), found.position_residual,
                          found.orientation_residual, found.newton_steps);
  }

  // Of a whole robot: target, no reference, what its search finds first, or, of the branch of
  // ``previous`` joint positions (dof,), next, and whether no check of it can refuse that; None if
  // the target may be refused. ``boxed``: begin at the solution in the box.
  py::object find(const PySearch& searching, const PyNetwork& network, bool boxed,
                  std::size_t most, const py::object& pose, const std::optional<Array>& previous) {
    const std::optional<Array> target = certain_target(pose);
    if (!target) return py::none();
    if (previous) check_shape(*previous, {dof_}, "previous");
    const Search& search = searching.search(dof_);
    const Placement goal = placement_of(target->data());
    const Found found = previous ? search.follow(joints_from(previous->data(), dof_), goal)
                                 : search.first(goal, starts(network, goal, boxed), most);
    return py::make_tuple(*target, py::tuple(), searching.tuple_of(found),
                          found.found && acceptable(found));
  }

  // All solutions of a whole robot, those nearest to joint positions ``near`` first: target, no
  // reference, and joint positions and residuals of each; None if a check may refuse one.
  py::object find_all(const PySearch& searching, const PyNetwork& network, bool boxed,
                      std::size_t most, double spacing, const py::object& pose,
                      const Array& near) {
    const std::optional<Array> target = certain_target(pose);
    if (!target) return py::none();
    check_shape(near, {dof_}, "near");
    const Search& search = searching.search(dof_);
    const Placement goal = placement_of(target->data());
    const std::vector<Joints> begin = starts(network, goal, boxed);
    const Joints middle = joints_from(near.data(), dof_);
    std::vector<Solution> found;
    {
      py::gil_scoped_release release;
      std::size_t taken = 0;
      found = search.all(goal, begin, most, spacing, taken);
      search.order(found, goal, middle);
    }
    py::list solutions;
    for (const Solution& one : found) {
      if (!acceptable(one)) return py::none();
      solutions.append(py::make_tuple(read_only(one.joint_positions.data(), dof_),
                                      one.position_residual, one.orientation_residual));
    }
    return py::make_tuple(*target, py::tuple(), std::move(solutions));
  }

 private:
  // The checked pose, its features written to the network's input; nothing if it may be refused.
  std::optional<Array> certain_target(const py::object& pose) {
    constructed(dof_);
    std::optional<Array> target = certain_pose(pose, norm_tolerance_);
    if (!target) return {};
    const double* p = target->data();
    // Not '>', so that NaN is left to Python too.
    if (!(norm(Vector3{p[0], p[1], p[2]} - centre_) <= reach_)) return {};
    const double x = p[3], y = p[4], z = p[5], w = p[6];
    const double features[] = {p[0], p[1], p[2], x * x, y * y, z * z, w * w,
                               x * y, x * z, x * w, y * z, y * w, z * w};
    std::copy_n(features, 13, features_);
    return target;
  }

  void run(const PyNetwork& network) {
    if (network.network().inputs != 13 || network.outputs() != dof_)
      throw std::invalid_argument("the network must have 13 inputs, and one output a joint");
    network.network().run(features_, output_.mutable_data());
  }

  bool finite_output() const {
    return std::all_of(found_, found_ + dof_, [](double x) { return std::isfinite(x); });
  }

  // Where a search begins: at the network's output, and before at the solution that it leads to.
  std::vector<Joints> starts(const PyNetwork& network, const Placement& target, bool boxed) {
    run(network);
    if (!finite_output()) return {};
    const Joints start = joints_from(found_, dof_);
    if (!boxed) return {start};
    return {refinement_.refine(start, target).joint_positions, start};
  }

  // Whether a solution is within its limits for certain.
  template <typename Reached>
  bool acceptable(const Reached& found) const {
    bool good = found.position_residual <= most_[0] && found.orientation_residual <= most_[1];
    for (py::ssize_t joint = 0; joint < dof_; ++joint)
      good = good && lower_[joint] <= found.joint_positions[joint] &&
             found.joint_positions[joint] <= upper_[joint];
    return good;
  }

  const Refinement refinement_;
  py::ssize_t dof_;
  Memory input_, output_;  // keeps the memory
  double* features_;
  const double* found_;
  Vector3 centre_{};
  double reach_;
  std::array<double, 2> most_;
  double norm_tolerance_;
  Joints lower_, upper_;
};

// The same for the gantry, whose network's output is the answer.
class PyBoundGantry : public Object {
 public:
  // ``input``, ``output``: the network's task coordinates (6,) and drive angles (6,). ``ratio``,
  // ``offset``: of the transmissions. ``inside``: bounds (2, 6) of task coordinates that are in the
  // workspace for certain, and of which the network is given roll and yaw; ``limits``: bounds
  // (2, 6) of drive angles.
  PyBoundGantry(const Memory& input, const Memory& output, const Array& ratio, const Array& offset,
                const Array& inside, const Array& limits, double max_position_residual,
                double max_orientation_residual, double norm_tolerance)
      : input_(input),
        output_(output),
        most_{max_position_residual, max_orientation_residual},
        norm_tolerance_(norm_tolerance) {
    for (const py::array* array : {static_cast<const py::array*>(&input),
                                   static_cast<const py::array*>(&output),
                                   static_cast<const py::array*>(&ratio),
                                   static_cast<const py::array*>(&offset)})
      check_shape(*array, {6}, "each of input, output, ratio and offset");
    check_shape(inside, {2, 6}, "inside");
    check_shape(limits, {2, 6}, "limits");
    gantry_ = {six_from(ratio.data()), six_from(offset.data())};
    inside_ = {six_from(inside.data()), six_from(inside.data() + 6)};
    limits_ = {six_from(limits.data()), six_from(limits.data() + 6)};
    task_ = aligned(input_.mutable_data());
    found_ = aligned(output_.data());
  }

  // The checked pose and its roll, pitch and yaw, its task coordinates written to the network's
  // input; None if it may be refused.
  py::object prepare(const py::object& pose) {
    constructed(task_ != nullptr);
    std::optional<Array> target = certain_pose(pose, norm_tolerance_);
    if (!target) return py::none();
    const Six task = Gantry::task_coordinates(target->data());
    if (!inside_.contain(task)) return py::none();
    std::copy(task.begin(), task.end(), task_);
    return py::make_tuple(std::move(*target), py::make_tuple(task[3], task[4], task[5]));
  }

  // Drive angles, residuals and no steps for the network's output; None if a check may refuse.
  py::object finish(const Array& target) const {
    constructed(task_ != nullptr);
    check_shape(target, {7}, "target");
    const Six angles = six_from(found_);
    const auto [distance, angle] = gantry_.residuals(angles, target.data());
    if (!limits_.contain(angles) || !(distance <= most_[0]) || !(angle <= most_[1]))
      return py::none();
    return py::make_tuple(read_only(angles.data(), 6), distance, angle, 0);
  }

 private:
  Memory input_, output_;  // keeps the memory
  double* task_ = nullptr;
  const double* found_ = nullptr;
  Gantry gantry_;
  Bounds inside_, limits_;
  std::array<double, 2> most_;
  double norm_tolerance_;
};

}  // namespace annik

#ifndef ANNIK_KERNEL_SOURCES  // setup.py gives it
#define ANNIK_KERNEL_SOURCES ""
#endif

PYBIND11_MODULE(compiled, module) {
  using namespace annik;
  module.doc() = "Forward kinematics and refinement of serial chains, compiled.";
  // SHA-256 of these sources: Python refuses a kernel that was built from others.
  module.attr("sources") = ANNIK_KERNEL_SOURCES;
  py::class_<PyChain>(module, "Chain")
      .def(py::init<const Array&, const Array&, const py::object&, const Array&,
                    const std::vector<std::size_t>&, const Array&>())
      .def("poses", &PyChain::poses)
      .def("jacobians", &PyChain::jacobians)
      .def("linearise", &PyChain::linearise)
      .def("residuals", &PyChain::residuals);
  py::class_<PyNetwork>(module, "Network")
      .def(py::init<std::size_t, const std::vector<PyNetwork::LayerOfPython>&>())
      .def("run", &PyNetwork::run);
  py::class_<PyErrorBound>(module, "ErrorBound")
      .def(py::init<const Array&, const Array&, const Array&>())
      .def("at", &PyErrorBound::at);
  py::class_<PyRefinement>(module, "Refinement")
      .def(py::init<const PyChain&, const Array&, const Array&, int, double>())
      .def("refine", &PyRefinement::refine)
      .def("refine_batch", &PyRefinement::refine_batch);
  py::class_<PyBoundSolve>(module, "BoundSolve")
      .def(py::init<const PyRefinement&, const Memory&, const Memory&, const Array&, double,
                    const Array&, const Array&, double, double, double>(),
           py::arg(), py::arg().noconvert(), py::arg().noconvert(), py::arg(), py::arg(),
           py::arg(), py::arg(), py::arg(), py::arg(), py::arg())
      .def("prepare", &PyBoundSolve::prepare)
      .def("solve", &PyBoundSolve::solve)
      .def("finish", &PyBoundSolve::finish)
      .def("find", &PyBoundSolve::find)
      .def("find_all", &PyBoundSolve::find_all);
  py::class_<PyBoundGantry>(module, "BoundGantry")
      .def(py::init<const Memory&, const Memory&, const Array&, const Array&, const Array&,
                    const Array&, double, double, double>(),
           py::arg().noconvert(), py::arg().noconvert(), py::arg(), py::arg(), py::arg(),
           py::arg(), py::arg(), py::arg(), py::arg())
      .def("prepare", &PyBoundGantry::prepare)
      .def("finish", &PyBoundGantry::finish);
  py::class_<PySearch>(module, "Search")
      .def(py::init<const PyRefinement&, std::size_t, double>())
      .def("first", &PySearch::first)
      .def("all", &PySearch::all)
      .def("follow", &PySearch::follow)
      .def("same_branch", &PySearch::same_branch);
}
