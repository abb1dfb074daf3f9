// The nearest of many points, all finite: a k-d tree.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

namespace annik {

// Most coordinates of a point.
constexpr std::size_t MAX_FEATURES = 12;

using Features = std::array<double, MAX_FEATURES>;

inline bool finite(const Features& features) {
  return std::all_of(features.begin(), features.end(), [](double x) { return std::isfinite(x); });
}

class NearestPoints {
 public:
  NearestPoints() = default;
  NearestPoints(std::vector<Features> points, std::size_t width)
      : points_(std::move(points)), axes_(points_.size()), order_(points_.size()), width_(width) {
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    build(0, points_.size());
  }

  // Squared distances and indices of the ``count`` nearest, nearest first.
  void find(const Features& point, std::size_t count,
            std::vector<std::pair<double, std::size_t>>& found) const {
    found.clear();
    if (count > 0) search(point, count, 0, points_.size(), found);
    std::sort_heap(found.begin(), found.end());
  }

 private:
  // The middle of a range splits it along the axis on which it is widest.
  void build(std::size_t begin, std::size_t end) {
    if (end - begin < 2) return;
    std::size_t axis = 0;
    double widest = -1.0;
    for (std::size_t i = 0; i < width_; ++i) {
      double low = points_[order_[begin]][i], high = low;
      for (std::size_t k = begin + 1; k < end; ++k) {
        low = std::min(low, points_[order_[k]][i]);
        high = std::max(high, points_[order_[k]][i]);
      }
      if (high - low > widest) widest = high - low, axis = i;
    }
    const std::size_t middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](std::size_t a, std::size_t b) { return points_[a][axis] < points_[b][axis]; });
    axes_[middle] = axis;
    build(begin, middle);
    build(middle + 1, end);
  }

  void search(const Features& point, std::size_t count, std::size_t begin, std::size_t end,
              std::vector<std::pair<double, std::size_t>>& found) const {
    if (begin >= end) return;
    const std::size_t middle = begin + (end - begin) / 2, index = order_[middle];
    double squared = 0.0;
    for (std::size_t i = 0; i < width_; ++i) {
      const double away = points_[index][i] - point[i];
      squared += away * away;
    }
    if (found.size() < count || squared < found.front().first) {
      if (found.size() == count) {
        std::pop_heap(found.begin(), found.end());
        found.pop_back();
      }
      found.push_back({squared, index});
      std::push_heap(found.begin(), found.end());
    }
    const double away = point[axes_[middle]] - points_[index][axes_[middle]];
    const bool below = away < 0.0;
    if (below) search(point, count, begin, middle, found);
    else search(point, count, middle + 1, end, found);
    if (found.size() < count || away * away < found.front().first) {
      if (below) search(point, count, middle + 1, end, found);
      else search(point, count, begin, middle, found);
    }
  }

  std::vector<Features> points_;
  std::vector<std::size_t> axes_, order_;
  std::size_t width_ = 0;
};

}  // namespace annik
