"""The widgets that several stations share: plots, tables, strips of grains, forms of options, sliders.

A widget knows neither stations nor the window; one that a single station uses lies in its folder.
"""
