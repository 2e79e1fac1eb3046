import{a,b,c}from"./chunk-7OLU6VFN.js";import"./chunk-KHNENPYX.js";import"./chunk-EXJ3EDRR.js";export{c as Live,b as LiveFigures,a as WALL};
