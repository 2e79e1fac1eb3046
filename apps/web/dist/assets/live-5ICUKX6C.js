import{a,b,c}from"./chunk-2U5XLJJQ.js";import"./chunk-MIJQ6J3D.js";import"./chunk-UUQQYBQQ.js";export{c as Live,b as LiveFigures,a as WALL};
