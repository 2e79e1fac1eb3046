import{a,b,c}from"./chunk-IN5Y76YH.js";import"./chunk-ZV6I3QMH.js";import"./chunk-AHLMVQEZ.js";export{c as Live,b as LiveFigures,a as WALL};
